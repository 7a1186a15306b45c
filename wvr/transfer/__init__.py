"""Transfer functions on their way to the device."""
