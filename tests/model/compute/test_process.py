"""What is set once in a process: that memory which was freed is kept for what is computed next."""
import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
# How many pages the system has to give for operations whose results are 16 MB.
FAULTS = """
import resource, sys
if "prepared" in sys.argv:
    import tools
import torch
x = torch.ones(1 << 22)
x + 1
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(20):
    (x + 1) * 2
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only GNU's C library has to be told")
def test_memory_that_was_freed_is_kept_unless_the_user_says_how():
    def faults(*arguments, **environment) -> int:
        clean = {name: value for name, value in os.environ.items() if not name.startswith(("MALLOC_", "GLIBC_"))}
        done = subprocess.run([sys.executable, "-c", FAULTS, *arguments], env=clean | environment, cwd=ROOT,
                              capture_output=True, text=True, check=True, timeout=600)
        return int(done.stdout)

    kept, as_the_user_says = faults("prepared"), faults("prepared", MALLOC_MMAP_THRESHOLD_="1000000")
    assert kept < as_the_user_says / 3
