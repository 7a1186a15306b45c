"""How a stretch of ray is integrated."""
