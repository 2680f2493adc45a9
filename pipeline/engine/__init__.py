"""The graph of jobs, the session that plans and runs it, the records of what is done, and the runners."""
