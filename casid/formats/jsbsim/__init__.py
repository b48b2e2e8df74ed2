"""JSBSim: its XML files as aircraft, read and written."""
