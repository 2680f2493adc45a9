"""What a system that refuses memory or a path is answered with."""

import errno

_REFUSALS = {
    errno.ENAMETOOLONG: "is longer than this system allows",
    errno.ENOSPC: "cannot be written: the disk is full",
    errno.EDQUOT: "cannot be written: your quota of disk space is used up",
    errno.EROFS: "cannot be written: its file system is read-only",
    errno.EACCES: "must not be read or written by you",
    errno.EPERM: "must not be read or written by you",
    errno.ELOOP: "is a link that leads to itself",
    errno.EMFILE: "cannot be opened: this shell allows too few open files (ulimit -n)",
}


def environment_sentence(error: OSError | MemoryError) -> str | None:
    """What the system refused, as a sentence; None for errors that say nothing of the user's system."""
    if isinstance(error, MemoryError):
        return "The system refused more memory; close other programs, or raise the limit of this shell (ulimit -v)."
    reason = _REFUSALS.get(error.errno or 0)
    if reason is None or error.filename is None:
        return None
    name = str(error.filename)
    shown = name if len(name) <= 200 else f"{name[:60]}...{name[-20:]} ({len(name)} characters)"
    return f"{shown.encode('unicode_escape').decode()} {reason}."
