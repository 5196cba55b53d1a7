"""Files that appear whole or not at all."""

import pytest

from msl_fem.errors import InputError
from msl_fem.files.whole_file import check_target, whole_file


def test_file_appears_only_when_the_block_ends_well(tmp_path):
    target = tmp_path / "new" / "a.txt"
    with whole_file(target) as partial:
        partial.write_text("content")
        assert not target.exists()
        assert partial.parent == target.parent, "another file system would not let it move at once"
    assert target.read_text() == "content"
    assert [p.name for p in target.parent.iterdir()] == ["a.txt"]


def test_file_is_readable_by_others(tmp_path):
    with whole_file(tmp_path / "a.txt") as partial:
        partial.write_text("content")
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o644


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_failed_block_leaves_nothing_and_touches_nothing(tmp_path, error):
    target = tmp_path / "a.txt"
    target.write_text("old")

    def write() -> None:
        with whole_file(target) as partial:
            partial.write_text("half")
            raise error

    with pytest.raises(error):
        write()
    assert target.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_two_writers_do_not_share_their_partial_files(tmp_path):
    with whole_file(tmp_path / "a.txt") as one, whole_file(tmp_path / "a.txt") as other:
        assert one != other
        one.write_text("one")
        other.write_text("other")
    assert (tmp_path / "a.txt").read_text() == "one", "the last to end wins, whole"


def test_folder_that_cannot_hold_it_is_an_input_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="another folder"), whole_file(tmp_path / "file" / "a.txt"):
        pytest.fail("the block must not begin")


def test_a_result_never_replaces_what_is_read(tmp_path):
    """By whatever name; the source itself, a link to it, not another file nor one that is not there yet."""
    source = tmp_path / "a.toml"
    source.write_text("a")
    (tmp_path / "link").symlink_to(source)
    for target in (source, tmp_path / "." / "a.toml", tmp_path / "link"):
        with pytest.raises(InputError, match="would be replaced"):
            check_target(target, apart_from=[tmp_path / "none", source])
    (tmp_path / "b.toml").write_text("b")
    check_target(tmp_path / "b.toml", apart_from=[source])
    check_target(tmp_path / "c.toml", apart_from=[source, tmp_path / "c.toml"])
    check_target(source)


def test_target_that_is_a_folder_is_an_input_error(tmp_path):
    (tmp_path / "a").mkdir()
    with pytest.raises(InputError, match="another name"), whole_file(tmp_path / "a") as partial:
        partial.write_text("content")
    assert [p.name for p in tmp_path.iterdir()] == ["a"]
