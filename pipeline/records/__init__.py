"""What is done: the records of jobs, the lock of a run, and whether what was done is still there."""
