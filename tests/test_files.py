import errno
import os

import pytest

from openmmhelfrich.files import replacing


def failAt(call):
    """Return an os.fsync that fails when it is called for the n-th time."""
    count = 0

    def fsync(descriptor):
        nonlocal count
        count += 1
        if count == call:
            raise OSError(errno.EIO, os.strerror(errno.EIO))

    return fsync


@pytest.mark.parametrize("call, named, isThere", [(1, "a", False), (2, "", True)])
def testErrorsNameTheFileOrItsFolder(inFolder, monkeypatch, call, named, isThere):
    """A folder by its whole name: that of the working folder is a dot."""
    monkeypatch.setattr(os, "fsync", failAt(call))
    with pytest.raises(OSError) as failed, replacing("a") as part:
        part.write_text("x")
    assert failed.value.filename == (named or str(inFolder))
    assert os.listdir() == ["a"] * isThere
