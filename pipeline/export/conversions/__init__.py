"""Products in other systems, areas, cells and formats, made from the files of a run."""
