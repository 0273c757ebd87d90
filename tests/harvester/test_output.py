import json

import pytest

from harvester.errors import OutputError
from harvester.output import check_writable, whole_file, write_json


def test_a_file_appears_whole_or_not_at_all(tmp_path):
    target = tmp_path / "deep" / "result.json"

    def fail_halfway():
        with whole_file(target) as file:
            file.write(b"half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail_halfway()
    assert list(tmp_path.iterdir()) == []
    write_json(target, {"value": 1.5})
    assert json.loads(target.read_text()) == {"value": 1.5}
    assert [path.name for path in target.parent.iterdir()] == ["result.json"]


def test_an_old_file_stays_until_the_new_one_is_whole(tmp_path):
    target = tmp_path / "result.json"
    write_json(target, {"value": "old"})
    with pytest.raises(ValueError, match="JSON"):
        write_json(target, {"value": float("nan")})
    assert json.loads(target.read_text()) == {"value": "old"}


def test_what_cannot_be_written_is_refused_before_the_run(tmp_path):
    check_writable(tmp_path / "new" / "result.json")
    assert list((tmp_path / "new").iterdir()) == []
    with pytest.raises(OutputError, match="cannot be written"):
        check_writable("/dev/null/result.json")
    with pytest.raises(OutputError, match="name a file"):
        check_writable(tmp_path)
