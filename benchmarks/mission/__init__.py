"""The page of the whole: every published system, how to reach it, and its published value beside ours."""
