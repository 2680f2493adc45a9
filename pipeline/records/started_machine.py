"""What tells one start of this machine from the next one."""

from pathlib import Path

import psutil

_BOOT = Path("/proc/sys/kernel/random/boot_id")


def boot() -> str:
    """What identifies the last start of this machine."""
    return _BOOT.read_text().strip() if _BOOT.exists() else f"{psutil.boot_time():.0f}"
