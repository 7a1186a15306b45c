"""Transfer functions: exact, pre-integrated, looked up."""
