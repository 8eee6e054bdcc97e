#!/usr/bin/env python3
"""Runs the first Python block of a page, which is how a newcomer meets the package.

tools/ten_lines.py README.md
"""

import re
import sys
from pathlib import Path

block = re.search(r"^```python\n(.*?)^```$", Path(sys.argv[1]).read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
if block is None:
    sys.exit(f"{sys.argv[1]}: it has no block of Python")
exec(compile(block[1], sys.argv[1], "exec"), {"__name__": "__main__"})
