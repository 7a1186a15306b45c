"""The scalar field: samples, cells, blocks of cells, and rays that walk through them."""
