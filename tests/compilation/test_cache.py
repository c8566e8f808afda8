"""Code is loaded from the cache: what others may have put there is refused."""

from __future__ import annotations

import os
import stat

import pytest

from phcontrol import CompilationError, CompilationWarning, compile_law, make_controller
from phcontrol.compilation import compiler as compiler_module
from phcontrol.compilation.cache import cache_folder, compiled, open_folder

SOURCE = "int phcontrol_law(void);\nint phcontrol_law(void) { return 41; }\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    place = tmp_path / "cache"
    monkeypatch.setenv("PHCONTROL_CACHE", str(place))
    return place


def mode(path):
    return stat.S_IMODE(path.lstat().st_mode)


def test_an_object_is_made_once_in_a_folder_of_ones_own(folder, compiler, monkeypatch):
    first = compiled(SOURCE, compiler)
    assert mode(folder) == 0o700
    assert mode(first) == 0o600
    assert sorted(path.suffix for path in folder.iterdir()) == [".sha256", ".so"]
    monkeypatch.setattr(type(compiler), "compile", lambda *_: pytest.fail("compiled again"))
    assert compiled(SOURCE, compiler) == first


def test_another_source_and_other_options_are_other_objects(folder, compiler):
    paths = {compiled(SOURCE, compiler), compiled(SOURCE + "\n", compiler), compiled(SOURCE, compiler, native=True)}
    assert len(paths) == 3


def spoil(path):
    path.write_bytes(path.read_bytes()[:-1] + b"\x00\x01")


def open_to_all(path):
    path.chmod(0o666)


def link(path):
    elsewhere = path.parent.parent / "planted.so"
    elsewhere.write_bytes(path.read_bytes())
    path.unlink()
    path.symlink_to(elsewhere)


def without_digest(path):
    path.with_suffix(".sha256").unlink()


@pytest.mark.parametrize("harm", [spoil, open_to_all, link, without_digest])
def test_a_corrupt_or_planted_object_is_refused_and_made_anew(harm, folder, compiler):
    path = compiled(SOURCE, compiler)
    before = path.read_bytes()
    harm(path)
    with pytest.warns(CompilationWarning, match="is refused and made anew"):
        assert compiled(SOURCE, compiler) == path
    assert not path.is_symlink()
    assert mode(path) == 0o600
    assert len(path.read_bytes()) == len(before)
    assert compiled(SOURCE, compiler) == path


def test_a_folder_that_others_may_use_is_refused(folder):
    folder.mkdir(mode=0o700)
    folder.chmod(0o755)
    with pytest.raises(CompilationError, match=r"is refused: others may use it \(mode 0755, should be 0700\)"):
        open_folder(folder)


def test_a_folder_below_one_that_everybody_may_write_to_is_refused(tmp_path):
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    with pytest.raises(CompilationError, match="everybody may write to"):
        open_folder(shared / "cache")


def test_a_folder_below_one_that_a_group_may_write_to_is_refused(tmp_path, monkeypatch):
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o770)
    found = os.stat

    def of_a_group(path, **options):
        status = found(path, **options)
        if not str(path).endswith("shared"):
            return status
        return os.stat_result((*status[:5], status.st_uid + 7, *status[6:]))

    monkeypatch.setattr(os, "stat", of_a_group)
    with pytest.raises(CompilationError, match=r"group \d+ may write to .*shared"):
        open_folder(shared / "cache")


def test_a_folder_below_somebody_elses_is_refused(tmp_path, monkeypatch):
    shared = tmp_path / "shared"
    shared.mkdir()
    found = os.stat

    def of_somebody(path, **options):
        status = found(path, **options)
        if not str(path).endswith("shared"):
            return status
        return os.stat_result((*status[:4], status.st_uid + 7, *status[5:]))

    monkeypatch.setattr(os, "stat", of_somebody)
    with pytest.raises(CompilationError, match=r"shared above it belongs to user"):
        open_folder(shared / "cache")


def test_a_sticky_folder_above_is_fine_and_a_link_below_an_open_one_is_not(tmp_path):
    shared, home = tmp_path / "shared", tmp_path / "home"
    shared.mkdir()
    home.mkdir()
    shared.chmod(0o1777)
    open_folder(shared / "cache")
    (shared / "link").symlink_to(home)
    shared.chmod(0o777)
    with pytest.raises(CompilationError, match="everybody may write to"):
        open_folder(shared / "link" / "cache")


def test_a_cache_that_is_refused_is_not_used(tmp_path, compiler, monkeypatch, shoulder):
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    monkeypatch.setenv("PHCONTROL_CACHE", str(shared / "cache"))
    with pytest.warns(CompilationWarning, match="compiled for this process only: .*everybody may write to"):
        law = compile_law(make_controller("energy_shaping", shoulder))
    assert law.report.covered == 1.0
    assert not law.report.library.is_relative_to(shared)
    assert mode(law.report.library.parent) == 0o700
    assert not list(shared.rglob("*.so"))


def test_the_cache_keeps_what_was_used_last(folder, compiler, monkeypatch):
    made = [compiled(f"{SOURCE}/* {k} */", compiler) for k in range(4)]
    for age, path in zip((400, 300, 200, 100), made, strict=True):
        os.utime(path, (path.stat().st_mtime - age,) * 2)
    compiled(f"{SOURCE}/* 0 */", compiler)  # used now
    monkeypatch.setattr("phcontrol.compilation.cache.LARGEST", 3 * made[0].stat().st_size + 100)
    new = compiled(f"{SOURCE}/* 4 */", compiler)
    assert {path for path in made if path.exists()} == {made[0], made[3]}
    assert new.exists()
    assert {path.stem for path in folder.glob("*.sha256")} == {path.stem for path in (made[0], made[3], new)}
    monkeypatch.setattr("phcontrol.compilation.cache.LARGEST", 1)
    last = compiled(f"{SOURCE}/* 5 */", compiler)  # larger than the cache by itself: stays
    assert list(folder.glob("*.so")) == [last]


def test_what_a_killed_process_left_is_removed(folder, compiler):
    compiled(SOURCE, compiler)
    old, new = folder / "making-old", folder / "making-new"
    for path in (old, new):
        path.mkdir()
        (path / "law.c").write_text("")
    os.utime(old, (0.0, 0.0))
    compiled(f"{SOURCE}/* 2 */", compiler)
    assert not old.exists()
    assert new.exists()


def test_a_link_in_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "real").mkdir(mode=0o700)
    (tmp_path / "cache").symlink_to(tmp_path / "real")
    with pytest.raises(CompilationError, match="symbolic link"):
        open_folder(tmp_path / "cache")


def test_somebody_elses_folder_is_refused(folder, monkeypatch):
    folder.mkdir(mode=0o700)
    monkeypatch.setattr(os, "geteuid", lambda: folder.stat().st_uid + 1)
    with pytest.raises(CompilationError, match="it belongs to user"):
        open_folder(folder)


def test_a_full_disk_gives_one_line(folder, compiler, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(CompilationError, match=r"cannot be written to: No space left on device$"):
        compiled(SOURCE, compiler)
    monkeypatch.undo()
    assert not folder.exists() or list(folder.iterdir()) == []


def test_on_macos_the_folder_is_where_its_caches_are(monkeypatch, tmp_path):
    monkeypatch.delenv("PHCONTROL_CACHE", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr("sys.platform", "darwin")
    assert cache_folder() == tmp_path / "Library" / "Caches" / "phcontrol" / "compiled"


def test_the_folder_is_the_users(monkeypatch):
    monkeypatch.delenv("PHCONTROL_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert str(cache_folder()) in ("/somewhere/phcontrol/compiled",)
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # the standard says: ignored
    assert cache_folder().is_absolute()


def wrapped(tmp_path, compiler, body):
    script = tmp_path / "cc"
    script.write_text(f'#!/bin/sh\n[ "$1" = --version ] && exec {compiler.path} --version\n{body}\n')
    script.chmod(0o755)
    return str(script)


@pytest.mark.parametrize("made", ["garbage", "int nothing;", "int phcontrol_law(double t) { return 0; }"])
def test_an_object_that_cannot_be_used_does_not_stay(made, folder, compiler, tmp_path, monkeypatch, shoulder):
    law = make_controller("energy_shaping", shoulder)
    find = 'while [ $# -gt 0 ]; do [ "$1" = -o ] && out="$2"; shift; done\n'
    command = f"echo '{made}'" + (
        ' > "$out"' if made == "garbage" else f' | {compiler.path} -x c -shared -fPIC -o "$out" -'
    )
    monkeypatch.setenv("CC", wrapped(tmp_path, compiler, find + command))
    with pytest.raises(CompilationError, match="cannot be loaded|answers at no random state"):
        compile_law(law)
    monkeypatch.setenv("CC", compiler.path)
    assert compile_law(law).report.covered == 1.0


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("echo 'ld: final link failed: No space left' >&2; echo 'collect2: error: ld returned 1' >&2; exit 1",
         "failed: ld: final link failed: No space left"),
        ("echo 'In file included from x' >&2; echo 'law.c:1: error: so' >&2; exit 1", "failed: law.c:1: error: so"),
        ("exit 3", "failed: it ended with code 3, and says nothing"),
        ("exit 0", "failed: it ended with code 0, and says nothing"),
        ("kill -9 $$", "failed: it was ended by signal 9"),
        ("exec sleep 20", "has not come to an end within 0.5 s, and was stopped"),
    ],
)  # fmt: skip
def test_a_compiler_that_fails_says_why_in_one_line(body, words, folder, compiler, tmp_path, monkeypatch):
    path = wrapped(tmp_path, compiler, body)
    monkeypatch.setattr(compiler_module, "_LONGEST", 0.5 if "sleep" in body else 60.0)
    with pytest.raises(CompilationError) as caught:
        compiled(SOURCE, compiler._replace(path=path))
    assert str(caught.value) == f"the compiler {path} {words}"
    assert not [left for left in folder.iterdir() if left.is_dir()]


def test_a_folder_or_a_pipe_in_place_of_an_object(folder, compiler):
    path = compiled(SOURCE, compiler)
    path.unlink()
    path.mkdir(0o700)
    with pytest.warns(CompilationWarning), pytest.raises(CompilationError, match="cannot be written to"):
        compiled(SOURCE, compiler)
    path.rmdir()
    os.mkfifo(path, 0o600)
    with pytest.warns(CompilationWarning, match="it is no file"):
        assert compiled(SOURCE, compiler) == path
    assert path.is_file()
