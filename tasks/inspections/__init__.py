"""What can be looked at in a single photograph, without a project. Inspections stand above the stages and below the catalogue."""
