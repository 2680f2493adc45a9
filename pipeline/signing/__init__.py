"""A person's signature under the results of a run."""
