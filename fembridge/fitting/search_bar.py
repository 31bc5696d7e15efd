"""A bar on a terminal while a search runs: its evaluations, and the front's best."""

from fembridge.progress import Bars
from neural.search import Progress


class SearchBar(Bars):
    """A bar for the search of each class, called with how far it is."""

    def __call__(self, afferent: str, progress: Progress) -> None:
        """Move the bar of this class."""
        self.show(afferent, progress.evaluations / progress.of, words_of(progress))


def words_of(progress: Progress) -> str:
    """Evaluations, the size of the front and its least RMSE, in a line."""
    return (
        f"{progress.evaluations}/{progress.of} evaluations, front of "
        f"{progress.front_size}, best RMSE {progress.least_rmse_ips:.3g} ips"
    )
