"""The scalar field on its way to the device."""
