"""Files and directories that are there whole or not at all."""

import pytest

from encircle.whole_files import OutputError, check_new, made_whole


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_file_gets_its_name_when_it_is_whole(tmp_path):
    with made_whole(tmp_path / "film.mp4") as unfinished:
        unfinished.write_text("half")
        assert unfinished.suffix == ".mp4"
        assert not (tmp_path / "film.mp4").exists()
        unfinished.write_text("whole")
    assert (tmp_path / "film.mp4").read_text() == "whole"
    assert names(tmp_path) == ["film.mp4"]


def test_a_directory_does_as_well(tmp_path):
    with made_whole(tmp_path / "tables") as unfinished:
        unfinished.mkdir()
        (unfinished / "a").write_text("a")
    assert (tmp_path / "tables" / "a").read_text() == "a"
    assert names(tmp_path) == ["tables"]


@pytest.mark.parametrize("is_directory", [False, True])
@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_nothing_is_left_of_what_was_given_up(tmp_path, is_directory, error):
    def give_up(path):
        with made_whole(path) as unfinished:
            if is_directory:
                unfinished.mkdir()
                (unfinished / "a").write_text("a")
            else:
                unfinished.write_text("a")
            raise error

    with pytest.raises(error):
        give_up(tmp_path / "it")
    assert names(tmp_path) == []


def test_what_is_there_stays_as_it_is(tmp_path):
    (tmp_path / "it").write_text("mine")
    with pytest.raises(OutputError, match="is there already"), made_whole(tmp_path / "it"):
        raise AssertionError("not reached")
    with pytest.raises(OutputError, match="is there already"):
        check_new(tmp_path / "it")
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with pytest.raises(OutputError, match="is there already"):
        check_new(tmp_path / "link")


def test_what_comes_there_meanwhile_stays_too(tmp_path):
    def make_both(path):
        with made_whole(path) as unfinished:
            unfinished.write_text("ours")
            path.write_text("theirs")

    with pytest.raises(OutputError, match="is there already"):
        make_both(tmp_path / "it")
    assert (tmp_path / "it").read_text() == "theirs"
    assert names(tmp_path) == ["it"]


def test_what_cannot_be_written_is_told(tmp_path):
    with pytest.raises(OutputError, match="nowhere is no directory"):
        check_new(tmp_path / "nowhere" / "it")
    with pytest.raises(OutputError, match="No space left"), made_whole(tmp_path / "it"):
        raise OSError(28, "No space left on device")
