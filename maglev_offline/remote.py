"""A workspace in a store: mirrored into a local folder, worked on there, and brought back.

In the store an artefact is a folder with a `manifest.json`, as it is locally, but each of its files lies in a folder
that is named after the file's hash: `samples/log-1/3f.../samples.parquet`. So a file that has changed never takes the
place of the one that the manifest of a reader names: new files come first, then the manifest in one move, and what no
manifest names any more is removed last. A command that is stopped on the way leaves the old artefact whole.

Files outside artefacts (`recipe.json`) lie as they are. Names that begin with a dot are not mirrored.
"""

import hashlib
import json
import os
import re
import shutil
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path, PurePosixPath

from maglev_offline.errors import ArtefactError, InputError
from maglev_offline.filesystems import is_address, without_keys
from maglev_offline.hashes import sha256_of
from maglev_offline.progress import SILENT, Progress
from maglev_offline.store import Entry, Store

MANIFEST = "manifest.json"
STATE = ".mirror.json"
"""File of the mirror: what the store held when the two were last the same."""

CACHE = "MAGLEV_OFFLINE_CACHE"
"""Environment variable: folder of the mirrors. Default: `maglev-offline` in the user's cache folder."""

THREADS = 8
_HASH = re.compile(r"[0-9a-f]{64}")
_OBJECT = re.compile(r"(.+?)/[0-9a-f]{32}/")
"""A file of an artefact in the store, and the artefact's folder."""


@contextmanager
def open_workspace(
    where: str | Path, *, command: str = "", cache: Path | None = None, progress: Progress = SILENT
) -> Iterator[Path]:
    """Give a local folder to work in: the path itself, or a mirror of the store at an address.

    What the body made or removed is brought to the store on leaving, also where it failed (what is finished is kept),
    but not where it was interrupted; then, or where bringing fails, the mirror keeps it for the next command.

    Raises
    ------
    InputError: the store cannot be reached, or refuses.
    WorkspaceLocked: another command works in it.
    """
    if isinstance(where, Path) or not is_address(where):
        yield Path(where)
        return
    root = cache if cache is not None else mirror_of(where)
    root.mkdir(parents=True, exist_ok=True)
    store = Store.open(where)
    with store.lock(command):
        mirror = Mirror(store, root, progress)
        mirror.pull()
        try:
            yield root
        except Exception:
            with suppress(InputError):  # the failure of the body is what must be told; the mirror keeps the rest
                mirror.push()
            raise
        mirror.push()


def mirror_of(address: str) -> Path:
    """Folder of the mirror of an address; keys and passwords are no part of its name."""
    home = os.environ.get(CACHE) or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "maglev-offline"
    return Path(home) / "workspaces" / hashlib.sha256(without_keys(address).rstrip("/").encode()).hexdigest()[:16]


@dataclass
class _State:
    """Of each artefact the hash of its manifest, of each loose file its hash, when mirror and store were the same.

    `stamps` are size and time in the store of what has such a hash, so that it need not be read again.
    """

    hashes: dict[str, str] = field(default_factory=dict)
    stamps: dict[str, list[int]] = field(default_factory=dict)


class Mirror:
    """A local folder that follows a store; an item is an artefact (by its manifest) or a file outside of artefacts."""

    def __init__(self, store: Store, root: Path, progress: Progress = SILENT) -> None:
        self.store, self.root, self.progress = store, root, progress
        self._state = _read_state(root / STATE)
        self._at_start: set[str] = set()

    def pull(self) -> None:
        """Bring here what changed in the store. Work that was not brought there yet stays, unless both changed.

        Raises
        ------
        InputError: the store fails, or what it holds is not what its manifests say.
        """
        entries = self.store.list()
        there = {item for item in _items(entries) if not _OBJECT.match(item)}
        here = _items(self._local_files())
        self._each("pull", lambda item: self._pull_item(item, entries[item], item in here), there)
        for item in here - there:
            if self._local_hash(item) == self._state.hashes.get(item):  # it was removed there
                self._drop_here(item)
                self._state.hashes.pop(item, None)
        for item in set(self._state.hashes) - there:
            del self._state.hashes[item]
        self._save()
        self._at_start = _items(self._local_files())

    def push(self) -> None:
        """Bring to the store what was made here, and remove there what was removed here.

        Raises InputError as `pull` does; the store then holds each artefact whole, as it was or as it is now.
        """
        here = _items(self._local_files())
        entries = self.store.list()
        changed = [item for item in sorted(here) if self._local_hash(item) != self._state.hashes.get(item)]
        try:
            self._each("push", lambda item: self._push_item(item, entries), changed)
            dropped = self._at_start - here
            for item in sorted(dropped):
                self._drop_there(item)
            for name in entries:  # what a command left there that was stopped before its manifest, or after it
                found = _OBJECT.match(name)
                if found and f"{found[1]}/{MANIFEST}" not in here | dropped:
                    self._remove_object(found[0], name, ())
        finally:
            self._save()

    def _pull_item(self, item: str, entry: Entry, is_here: bool) -> None:
        stamp = [entry.size, entry.modified_ns or 0]
        base, content = self._state.hashes.get(item), None
        if base is not None and entry.modified_ns is not None and self._state.stamps.get(item) == stamp:
            there = base
        else:
            content = self.store.read(item) or b""
            there = hashlib.sha256(content).hexdigest()
        local = self._local_hash(item) if is_here else None
        if local == there or (local is not None and local != base and there == base):
            pass  # the same, or work that is not in the store yet
        else:
            content = content if content is not None else self.store.read(item) or b""
            self._bring_here(item, content)
            there = hashlib.sha256(content).hexdigest()
        self._state.hashes[item], self._state.stamps[item] = there, stamp

    def _bring_here(self, item: str, content: bytes) -> None:
        target = self.root / item
        if target.name != MANIFEST:
            target.parent.mkdir(parents=True, exist_ok=True)
            draft = target.with_name(f".{target.name}.draft")
            draft.write_bytes(content)
            draft.replace(target)
            return
        folder, files = target.parent, _files_of(content, self._where(item))
        if not folder.name or folder == self.root:
            raise ArtefactError("an artefact lies in a folder.", where=self._where(item), todo="Remove the file.")
        # Names that are always the same: what a killed command left is cleared here, when its item comes again.
        draft, retired = folder.with_name(f".{folder.name}.draft"), folder.with_name(f".{folder.name}.old")
        for leftover in (draft, retired):
            shutil.rmtree(leftover, ignore_errors=True)
        try:
            draft.mkdir(parents=True)
            for name, sha256 in files.items():
                (draft / name).parent.mkdir(parents=True, exist_ok=True)
                if (folder / name).is_file() and sha256_of(folder / name) == sha256:
                    shutil.copy2(folder / name, draft / name)
                else:
                    self.store.fetch(_object(item, name, sha256), draft / name, sha256)
            (draft / MANIFEST).write_bytes(content)
            if folder.exists():
                folder.rename(retired)
            draft.rename(folder)
        finally:
            if retired.exists() and not folder.exists():
                retired.rename(folder)
            for leftover in (draft, retired):
                shutil.rmtree(leftover, ignore_errors=True)

    def _push_item(self, item: str, entries: dict[str, Entry]) -> None:
        content = (self.root / item).read_bytes()
        wanted = set()
        if PurePosixPath(item).name == MANIFEST:
            for name, sha256 in _files_of(content, str(self.root / item)).items():
                source, target = (self.root / item).parent / name, _object(item, name, sha256)
                wanted.add(target)
                if target in entries and entries[target].size == source.stat().st_size:
                    continue  # a command that was stopped brought it
                if sha256_of(source) != sha256:
                    todo = "Remove that folder and run its stage again."
                    raise ArtefactError("the file is not what was written there.", where=str(source), todo=todo)
                self.store.send(source, target)
        self.store.put(item, content)
        self._state.hashes[item] = hashlib.sha256(content).hexdigest()
        self._state.stamps.pop(item, None)
        if PurePosixPath(item).name == MANIFEST:
            home = str(PurePosixPath(item).parent)
            for name in entries:
                found = _OBJECT.match(name) if name.startswith(home) else None
                if found and found[1] == home and name not in wanted:
                    self._remove_object(found[0], name, wanted)

    def _remove_object(self, folder: str, name: str, wanted: Collection[str]) -> None:
        """Remove a file that no manifest names, with the folder of its hash: S3 keeps an empty folder as an object."""
        if any(other.startswith(folder) for other in wanted):
            self.store.remove(name)
        else:
            self.store.remove_folder(folder.rstrip("/"))

    def _drop_here(self, item: str) -> None:
        target = self.root / item
        if target.name == MANIFEST:
            shutil.rmtree(target.parent)
        else:
            target.unlink()

    def _drop_there(self, item: str) -> None:
        self.store.remove(item)  # the manifest first: without it, there is no artefact
        if PurePosixPath(item).name == MANIFEST:
            self.store.remove_folder(str(PurePosixPath(item).parent))
        self._state.hashes.pop(item, None)

    def _local_files(self) -> list[str]:
        found = []
        for folder, folders, names in os.walk(self.root):
            folders[:] = [name for name in folders if not name.startswith(".")]
            relative = Path(folder).relative_to(self.root)
            found += [(relative / name).as_posix() for name in names if not name.startswith(".")]
        return found

    def _local_hash(self, item: str) -> str:
        return sha256_of(self.root / item)

    def _where(self, item: str) -> str:
        return self.store.where(item)

    def _each(self, title: str, do: Callable[[str], None], items: Iterable[str]) -> None:
        """Do it for each item, several at a time; the first failure ends it once those under way are done."""
        todo = sorted(items)
        with self.progress.task(title, len(todo), "artefact") as tick, ThreadPoolExecutor(THREADS) as pool:
            under_way = [pool.submit(do, item) for item in todo]
            try:
                for one in under_way:
                    one.result()
                    tick(1)
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise

    def _save(self) -> None:
        draft = self.root / f"{STATE}.draft"
        draft.write_text(json.dumps(asdict(self._state), sort_keys=True), encoding="utf-8")
        draft.replace(self.root / STATE)


def _items(files: Iterable[str]) -> set[str]:
    """The manifests, and the files that lie in no artefact."""
    names = set(files)
    homes = {name.rpartition("/")[0] for name in names if name.rpartition("/")[2] == MANIFEST}

    def of_an_artefact(name: str) -> bool:
        return any(str(parent) in homes for parent in PurePosixPath(name).parents)

    return {name for name in names if name.rpartition("/")[2] == MANIFEST or not of_an_artefact(name)}


def _object(item: str, name: str, sha256: str) -> str:
    """Where in the store a file of an artefact lies; the file keeps its own name, so that others can read it."""
    return f"{PurePosixPath(item).parent}/{sha256[:32]}/{name}"


def _files_of(content: bytes, where: str) -> dict[str, str]:
    """Files and hashes of a manifest; a store may be another's, so that no name may lead out of the artefact."""
    try:
        files = json.loads(content)["files"]
        good = all(
            isinstance(name, str) and isinstance(sha256, str) and _HASH.fullmatch(sha256) and _is_inside(name)
            for name, sha256 in files.items()
        )
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        good, files = False, {}
    if not good:
        raise ArtefactError("the manifest cannot be read.", where=where, todo="Remove its folder and run again.")
    return dict(files)


def _is_inside(name: str) -> bool:
    path = PurePosixPath(name)
    return bool(name) and not path.is_absolute() and ".." not in path.parts and "\0" not in name and name != MANIFEST


def _read_state(path: Path) -> _State:
    """What is known of the store; a file that is damaged is none, and then everything is compared anew."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        hashes = {str(name): str(sha256) for name, sha256 in data["hashes"].items()}
        stamps = {str(name): [int(n) for n in stamp] for name, stamp in data["stamps"].items()}
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return _State()
    return _State(hashes, stamps)
