"""What workers are asked for and given: terms, numbers, jobs that go together."""
