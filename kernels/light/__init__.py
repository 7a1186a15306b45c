"""Light: on points, on segments, on its way."""
