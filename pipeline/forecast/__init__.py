"""What a project will take before it can be planned exactly: jobs, disk, memory and time, from what other projects took."""
