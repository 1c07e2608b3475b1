"""What tests of compiled kernels share: every instruction set that runs here, one after another."""

import pytest

from comanip import kernels


@pytest.fixture(params=kernels.native.levels() if kernels.native else [])
def level(request):
    before = kernels.native.level()
    kernels.native.use(request.param)
    yield request.param
    kernels.native.use(before)
