"""Memory that many threads have freed goes back to few heaps."""

import platform
import subprocess
import sys

import pytest

from auv_gym.cli.options import heaps

HEAPS = """
import ctypes, sys, tempfile
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
from auv_gym.cli import main
if sys.argv[1] == "few":
    main(["--version"])
together = Barrier(6)
with ThreadPoolExecutor(6) as pool:
    list(pool.map(lambda size: (together.wait(), bytearray(size)), [50_000] * 6))
library = ctypes.CDLL(None)
with tempfile.NamedTemporaryFile() as file:
    library.fopen.restype = ctypes.c_void_p
    stream = ctypes.c_void_p(library.fopen(file.name.encode(), b"w"))
    library.malloc_info(0, stream)
    library.fclose(stream)
    print(open(file.name).read().count("<heap "))
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc gives each thread a heap of its own")
def test_threads_of_the_command_share_two_heaps():
    def count(how: str) -> int:
        done = subprocess.run([sys.executable, "-c", HEAPS, how], capture_output=True, text=True, check=True)
        return int(done.stdout.split()[-1])

    assert count("few") <= 2
    assert count("many") > 2


def test_another_c_library_does_without(monkeypatch):
    monkeypatch.setattr(heaps.ctypes, "CDLL", lambda name: object())
    assert heaps.with_few_heaps() is False
