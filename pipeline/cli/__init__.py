"""The command line: `orthomill` and its subcommands."""
