"""The walk through a post file, from block to block and increment to increment.

Values are passed, not read: what is kept is where they are. A block that is not
known, or not built as known, is passed by its records up to its ``=end=`` and
remarked. An increment counts when its ``----`` stands there; at the first place
that is cut or damaged the walk ends, and what was whole before is what there is.
"""

from dataclasses import dataclass, replace

from fembridge.results.marc_format import increment as parts
from fembridge.results.marc_format import model as model_parts
from fembridge.results.marc_format.content import PostIncrement
from fembridge.results.marc_format.increment import Layout, read_increment_block
from fembridge.results.marc_format.model import Model, read_model_block
from fembridge.results.marc_format.records import (
    BEGIN,
    END,
    FILE_END,
    INCREMENT,
    INCREMENT_END,
    PostDamageError,
    PostRecords,
)
from fembridge.results.marc_format.repeats import Alike, Repeats

_TITLE, _DOMAIN = 501, 505
_MODEL_BLOCKS = range(502, 515)  # what comes again with a new mesh
_SEEN_REVISIONS = (12, 14)
# Blocks that real files have, or that are documented: others are remarked.
_PASSED = (501, 504, 505, 510, 514, 515, 519, 520, *range(530, 537), *range(540, 544))
_BLOCKS = {*_PASSED, *model_parts.BLOCKS, *parts.BLOCKS}
_MOST_REMARKS = 100
_MOST_BLANKS = 1 << 16  # behind the end of a file


@dataclass(frozen=True, slots=True)
class Place:
    """An increment laid out as `layout` is, `further` bytes on in the file."""

    layout: Layout
    further: int


class PostWalk:
    """The state of one walk: where it is and what it has met."""

    def __init__(self, records: PostRecords) -> None:
        self.records = records
        self.title = ""
        self.models: list[Model] = []
        self.increments: list[PostIncrement] = []
        self.places: list[Place] = []
        self.remarks: list[str] = []
        self.problem: str | None = None
        self.whole_bytes = 0  # up to here every byte belongs to a block
        self._repeats = Repeats(records.file)
        self._where = ""
        self._unknown: set[int] = set()

    def run(self) -> None:
        """Walk to the end, or as far as the file can be understood.

        Raises
        ------
        PostDamageError
            There is no whole model at the beginning.
        """
        self._header()
        try:
            while (word := self.records.word()) == INCREMENT:
                alike = self._repeats.find(self.records.at)
                if alike is None:
                    self._increment()
                else:
                    self._take(alike)
            self._ending(word)
        except PostDamageError as damage:
            self.problem = self.words(damage)

    def words(self, damage: PostDamageError) -> str:
        """Say what is damaged, in which block, and at which byte."""
        return f"{damage.problem}, {self._where} (byte {damage.at})"

    def _header(self) -> None:
        self._where = "at the beginning"
        model = Model()
        while (word := self.records.word()).startswith(BEGIN):
            base, revision = self._open(word, "of the model")
            if base == _TITLE:
                self.title = self.records.text()
            elif base == _DOMAIN:
                self._domain()
            elif base in model_parts.BLOCKS:
                model = self._model_block(base, revision, model)
            self._close(base in (_DOMAIN, *model_parts.BLOCKS))
        if word not in (INCREMENT, FILE_END):
            raise self._unexpected(f"{BEGIN} or {INCREMENT}")
        self._where = "before the first increment"
        if model.revision not in _SEEN_REVISIONS:
            self._remark(f"post revision {model.revision}: real files of 12 and 14 were seen")
        self.models.append(model)
        self.whole_bytes = self.records.at

    def _domain(self) -> None:
        domains, number = self.records.integers(2)
        if domains > 1:
            self._remark(f"part {number} of a model that was solved in {domains} domains")

    def _increment(self) -> None:
        records = self.records
        start, model = records.at, self.models[-1]
        new_model = False
        layout = Layout(start)
        records.free.clear()
        name = f"of the increment that begins at byte {start}"
        self._where = name
        records.pass_word()
        while (word := records.word()).startswith(BEGIN):
            base, revision = self._open(word, name)
            if base in parts.BLOCKS:
                layout = self._increment_block(base, model, layout)
            elif base in _MODEL_BLOCKS:
                new_model = True
                if base in model_parts.BLOCKS:
                    model = self._model_block(base, revision, model)
            if base == parts.INTEGERS and layout.integers is not None:
                number = int(layout.integers.values(records.file)[0, 1])
                name = f"of increment {number}"
            self._close(base in (*parts.BLOCKS, *model_parts.BLOCKS))
        if word != INCREMENT_END:
            raise self._unexpected(f"{BEGIN} or {INCREMENT_END}")
        records.pass_word()
        if layout.integers is None or layout.reals is None:
            raise PostDamageError("an increment without its number and time", start)
        if new_model:
            self.models.append(model)
            self._repeats.forget()
        else:
            self._repeats.add(layout, records.at, records.free)
        integers = layout.integers.values(records.file)
        reals = layout.reals.values(records.file)[:, :2]
        title = ""
        if layout.title is not None:
            first, last = layout.title
            title = records.text_of(records.file.take(first, last - first))
        self._append(start, layout, integers[0].tolist(), reals[0].tolist(), title)

    def _take(self, alike: Alike) -> None:
        """Take increments that look like one before; they share a few titles."""
        at = self.records.at
        titles = {raw: self.records.text_of(raw) for raw in set(alike.titles)}
        for words, reals, raw in zip(
            alike.integers.tolist(), alike.reals.tolist(), alike.titles, strict=True
        ):
            title = titles[raw]
            self._append(at, alike.layout, words, reals, title)
            at += alike.length
        self.records.at = self.whole_bytes = at

    def _append(
        self, at: int, layout: Layout, words: list[int], reals: list[float], title: str
    ) -> None:
        self.places.append(Place(layout, at - layout.start))
        self.increments.append(
            PostIncrement(
                row=len(self.increments),
                increment=words[1],
                sub_increment=words[2],
                time_s=reals[0],
                title=title,
                mesh=len(self.models) - 1,
                recycles=words[7],
                cut_backs=words[9],
                has_element_values=layout.element_values is not None,
                nodal=layout.nodal,
                harmonic=words[6],
                frequency=reals[1],
            )
        )
        self.whole_bytes = self.records.at

    def _model_block(self, base: int, revision: int, model: Model) -> Model:
        if base != model_parts.SETS:
            return read_model_block(self.records, base, revision, model)
        start = self.records.at
        try:
            return read_model_block(self.records, base, revision, model)
        except PostDamageError as damage:
            self._retry(start, damage)
            return replace(model, sets=())

    def _increment_block(self, base: int, model: Model, layout: Layout) -> Layout:
        start, passed = self.records.at, len(self.records.free)
        try:
            return read_increment_block(self.records, base, model, layout)
        except PostDamageError as damage:
            if base in parts.NEEDED:
                raise
            del self.records.free[passed:]
            self._retry(start, damage)
            return layout

    def _retry(self, start: int, damage: PostDamageError) -> None:
        """Pass a block that is whole and not built as known; else say why not."""
        self.records.at = start
        try:
            self.records.pass_block()
        except PostDamageError:
            raise damage from None
        also = ", also in increments built alike" if self.models else ""
        self._remark(f"{self.words(damage)}: left out{also}")

    def _open(self, word: str, of: str) -> tuple[int, int]:
        number = word[len(BEGIN) :].split(" ", 1)[0]
        self._where = f"in block {number} {of}"
        if len(number) != 5 or not number.isdecimal():
            raise PostDamageError(f"{word!r} has no number", self.records.at)
        self.records.pass_word()
        base, revision = divmod(int(number), 100)
        if base not in _BLOCKS and base not in self._unknown:
            self._unknown.add(base)
            self._remark(f"block {word[len(BEGIN) :]} is not known: passed")
        return base, revision

    def _close(self, known: bool) -> None:
        """Go behind the ``=end=`` of a block."""
        if known and self.records.word() != END:
            also = ", also in increments built alike" if self.models else ""
            self._remark(f"{self._where}: more than is known, left out{also}")
        self.records.pass_block()
        self.records.pass_word()

    def _ending(self, word: str) -> None:
        records = self.records
        self._where = "at the end"
        if word == FILE_END:
            records.pass_word()
            self.whole_bytes = records.at
            rest = records.file.size - records.at
            if records.file.peek(records.at, min(rest, _MOST_BLANKS)).strip():
                self._remark(f"{rest} bytes behind the end of the file")
            else:
                self.whole_bytes = records.file.size
        elif records.at >= records.file.size:
            self.problem = f"no {FILE_END} at the end: the run is going on, or was stopped"
        else:
            raise self._unexpected(f"{INCREMENT} or {FILE_END}")

    def _unexpected(self, expected: str) -> PostDamageError:
        at = self.records.at
        found = self.records.word() or repr(self.records.file.peek(at, 24))
        if at >= self.records.file.size:
            found = "nothing"
        return PostDamageError(f"{found} where {expected} is expected", at)

    def _remark(self, remark: str) -> None:
        if len(self.remarks) < _MOST_REMARKS:
            self.remarks.append(remark)
