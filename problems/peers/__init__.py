"""The same estimation by other packages."""
