"""What is measured of orthomill, and the commands that measure it; results stand in benchmarks/results."""
