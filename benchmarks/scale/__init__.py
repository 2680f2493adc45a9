"""What grows with a project and with a cluster: the engine's own cost of a job, and runs that nobody can make here."""
