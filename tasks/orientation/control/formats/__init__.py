"""Control in the files of other programs that are no tables: markup, JSON and the words of total stations."""
