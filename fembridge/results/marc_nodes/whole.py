"""Whether a post file is fit to be read: whole, and not changing."""

from fembridge.errors import ResultError
from fembridge.results.marc_format.post_file import PostFile
from fembridge.results.mentat.sts import read_sts
from fembridge.results.read_options import ReadOptions


def check_whole(post: PostFile, options: ReadOptions) -> None:
    """Pass on what the file remarks; refuse one that is cut.

    A file that is whole may be of a job that gave up: the ``.sts`` beside tells, and
    is passed on. The increments that are there were converged.

    Raises
    ------
    ResultError
        It is cut or damaged, and `options.partial` is not set.
    """
    for remark in (*post.remarks, *_status(post)):
        options.note(remark)
    if post.problem is None:
        return
    if not options.partial:
        raise ResultError(
            f"{post.problem}; --partial (partial=True) takes what is whole", post.path
        )
    options.note(post.problem)


def _status(post: PostFile) -> list[str]:
    """Say what is wrong with the job, as the status file beside has it."""
    beside = post.path.with_suffix(".sts")
    if not beside.is_file():
        return []
    try:
        problem = read_sts(beside).problem
    except ResultError:  # it is not what was asked for
        return []
    return [] if problem is None else [f"{beside.name}: {problem}"]


def check_unchanged(post: PostFile, options: ReadOptions) -> None:
    """Refuse a file that something wrote to while it was read.

    Raises
    ------
    ResultError
        It changed, and `options.partial` is not set.
    """
    if post.change is None:
        return
    if not options.partial:
        raise ResultError(f"{post.change}; read it again when the run has ended", post.path)
    options.note(post.change)
