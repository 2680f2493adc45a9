"""The commands, as the terminal knows them: words, options, and which function does the work.

Only the lines of the terminal are imported here. What a command works with is imported inside it, so that the version, the help and
the completion of the shell answer at once (tests/pipeline/cli/test_loaded_modules.py holds the list). An interruption while
libraries are loaded is answered by the entry (environment.py); from `plain_errors` on the command listens itself.
"""
