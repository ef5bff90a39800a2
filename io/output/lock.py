"""A lock beside a result file, so that two runs do not write the same one."""

import errno
import fcntl
import os
import platform
from pathlib import Path

_WITHOUT_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)


class Locked(Exception):
    """Another run holds the lock; the text names it."""


class Lock:
    """Holds `<path>.lock`, which is gone after `release`; the system frees it when the process dies.

    Raises Locked if another process holds it, OSError if the file cannot be made. On a file system without locks
    nobody is kept out.
    """

    def __init__(self, path: Path):
        self.path = path.with_name(path.name + ".lock")
        self._handle = self._take()
        os.ftruncate(self._handle, 0)
        os.write(self._handle, f"process {os.getpid()} on {platform.node()}".encode())

    def _take(self) -> int:
        while True:
            handle = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o644)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                holder = os.read(handle, 200).decode(errors="replace")
                os.close(handle)
                raise Locked(holder) from None
            except OSError as error:
                if error.errno not in _WITHOUT_LOCKS:
                    os.close(handle)
                    raise
            if self._is_at_its_place(handle):
                return handle
            os.close(handle)  # the one who held it removed it meanwhile

    def _is_at_its_place(self, handle) -> bool:
        try:
            return os.stat(self.path).st_ino == os.fstat(handle).st_ino
        except FileNotFoundError:
            return False

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.release()

    def release(self) -> None:
        """Let others in."""
        self.path.unlink(missing_ok=True)
        os.close(self._handle)
