"""What tells one start of this machine from the next one."""

from pathlib import Path

_BOOT = Path("/proc/sys/kernel/random/boot_id")


def boot() -> str:
    """What identifies the last start of this machine."""
    if _BOOT.exists():
        return _BOOT.read_text().strip()
    import psutil

    return f"{psutil.boot_time():.0f}"
