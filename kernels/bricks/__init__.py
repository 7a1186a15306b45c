"""Parts of a grid, and images of them."""
