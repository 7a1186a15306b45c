"""Light: on what is emitted, and on its way."""
