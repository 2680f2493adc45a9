"""From YAML to a typed workflow, and from every mistake in it to a sentence that helps."""
