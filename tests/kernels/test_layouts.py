"""Blocks of numbers that Python and C share: a wrong order on either side fails at import, and names the field."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields

import numpy as np
import pytest

from comanip import kernels
from comanip.kernels import layouts
from comanip.skills.roles import RolePolicy


@pytest.mark.skipif(kernels.native is None, reason="nothing compiled")
@pytest.mark.parametrize("block", layouts.BLOCKS)
def test_c_states_every_block_in_the_same_order(block):
    assert tuple(kernels.native.layouts()[block].split()) == layouts.BLOCKS[block]


@pytest.mark.parametrize("block", layouts.BLOCKS)
@pytest.mark.parametrize("wrong", ["swapped", "missing", "one more"])
def test_another_order_in_any_block_is_refused_by_the_name_of_its_first_field(block, wrong):
    """As C states it: two fields swapped, one left out, one too many; at any place of the block."""
    names = list(layouts.BLOCKS[block])
    for n in range(len(names) - 1):
        other = list(names)
        if wrong == "swapped":
            other[n], other[n + 1] = other[n + 1], other[n]
        elif wrong == "missing":
            del other[n]
        else:
            other.insert(n, "stray")
        stated = {name: " ".join(fields) for name, fields in layouts.BLOCKS.items()} | {block: " ".join(other)}
        match = rf"block '{block}' differs at field {n + 1}: kernels/layouts.py has {names[n]}, C has {other[n]};"
        with pytest.raises(ImportError, match=match.replace(".", r"\.")):
            layouts.check(stated)


@pytest.mark.skipif(kernels.native is None, reason="nothing compiled")
@pytest.mark.parametrize("block", layouts.BLOCKS)
def test_the_import_fails_where_layouts_py_has_another_order(block, tmp_path):
    """With two names swapped in a copy of the package's own file, in a process of its own."""
    first, second = layouts.BLOCKS[block][:2]
    code = (
        "import sys, importlib.util as u, importlib.machinery as m, comanip\n"
        f"text = open({layouts.__file__!r}).read()\n"
        f"at = text.index('    \"{block}\": (')\n"
        f'head, tail = text[:at], text[at:].replace(\'"{first}", "{second}",\', \'"{second}", "{first}",\', 1)\n'
        "class Planted:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        return m.ModuleSpec(name, self) if name == 'comanip.kernels.layouts' else None\n"
        "    def create_module(self, spec): return None\n"
        "    def exec_module(self, module): exec(head + tail, module.__dict__)\n"
        "sys.meta_path.insert(0, Planted())\n"
        "import comanip.kernels\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode, block
    assert f"ImportError: block '{block}' differs at field 1: kernels/layouts.py has {second}, C has {first}" in done.stderr


def test_numbers_are_packed_by_name():
    values = {name: float(n) for n, name in enumerate(layouts.BLOCKS["wrist"])}
    assert np.array_equal(layouts.packed("wrist", dict(reversed(values.items()))), np.arange(14.0))
    assert set(layouts.BLOCKS["policy"]) <= {f.name for f in fields(RolePolicy)}
