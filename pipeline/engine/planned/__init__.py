"""What is known of planned jobs, in columns: a plan of a million jobs is no million objects."""
