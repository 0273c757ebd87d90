"""The list of faults fits the sources as they are."""

import pytest
from maintenance.fault_list import FAULTS
from maintenance.faults import NOT_RUN, NOT_SEEN, ROOT, SEEN, judged, misplaced


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.title)
def test_every_fault_has_its_place_and_its_tests(fault):
    assert not misplaced(fault)
    assert fault.after != fault.before
    assert "\n" not in fault.before + fault.after
    assert fault.tests
    for test in fault.tests:
        name, *functions = test.split("::")
        path = ROOT / "tests" / name
        assert path.exists(), test
        assert all(f"def {each}(" in path.read_text() for each in functions), test


def test_a_fault_that_is_not_tried_is_not_seen():
    assert judged(0, "") == (NOT_SEEN, "")
    assert judged(1, "FAILED tests/a.py::test_b[c] - assert 1\n") == (SEEN, "tests/a.py::test_b[c]")
    assert judged(1, "E   numba.TypingError: no\nFAILED tests/a.py::b")[0] == NOT_RUN
    for code in (2, 3, 4, 5, None):
        assert judged(code, "ERROR tests/a.py - NameError\n")[0] == NOT_RUN
