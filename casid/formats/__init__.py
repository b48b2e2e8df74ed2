"""Write and read an aircraft as files of other simulators; what they cannot hold is reported."""
