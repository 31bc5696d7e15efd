# Runs in the Python of Mentat or Abaqus, 2.7 or 3.6 and later, with its standard library alone.
# ruff: noqa: ANN001, ANN003, ANN201, ANN202, ANN204, SIM118, B904, B905, PTH107, PTH110, PTH113, PTH118
# ruff: noqa: PTH119, PTH122, PTH123, UP010, UP024, UP031
# mypy: ignore-errors
"""Write von Mises stress at nodes of a Marc post file or an Abaqus .odb as a table for fembridge.

    python export.py job.t16 --list
    python export.py job.t16 --afferent SA=4711 RA=4712 PC=88 -o traces.csv
    python export.py job.t16 --near 0.4,-1.2 --within dermis_elements -o traces.csv
    abaqus python export.py job.odb --afferent SA=4711 -o traces.csv

This runs in Mentat's own Python and reads with its py_post, or in that of Abaqus with its
odbAccess; no window opens. The table, time_ms,afferent,node,von_mises_pa, is what "fembridge
encode" reads. A value at a node is the mean, over the elements there, of what py_post or Abaqus
(ELEMENT_NODAL) extrapolates to it. Neither has units: time is taken as s, stress as --unit. Made
from descriptions of py_post and of odbAccess (Abaqus Scripting Reference, "Odb commands") and tried
against imitations of them, never yet in Mentat or Abaqus itself.
"""

from __future__ import division, print_function

import argparse
import math
import os
import sys

AFFERENTS = ("SA", "RA", "PC")
COLUMNS = "time_ms,afferent,node,von_mises_pa"
PA_PER_UNIT = {"MPa": 1.0e6, "kPa": 1.0e3, "Pa": 1.0}
STEP_TOLERANCE = 1.0e-3  # of the mean step, as fembridge has it
LABELS = {"scalar": "Equivalent Von Mises Stress", "tensor": "Stress"}
TENSOR = ("t11", "t22", "t33", "t12", "t23", "t13")

NO_PY_POST = """py_post cannot be imported by this Python, %s (%s): %s
Run this file with the Python that came with Mentat, on Windows for instance
  "C:\\Program Files\\MSC.Software\\Marc\\2024.1.0\\mentat2024.1\\python\\WIN8664\\\
python.exe" export.py ...
and if that does not find py_post either, name the folder of Mentat:
  --mentat "C:\\Program Files\\MSC.Software\\Marc\\2024.1.0\\mentat2024.1\""""


NO_ABAQUS = """odbAccess cannot be imported by this Python, %s (%s): %s
Run this file with the Python of Abaqus:
  abaqus python export.py job.odb ..."""


class ExportError(Exception):
    """What keeps the table from being written; the words are for the user."""


class Quantity:
    """What is read at an element: a scalar, or a tensor to make von Mises of."""

    def __init__(self, kind, label):
        self.kind, self.label = kind, label or LABELS[kind]

    def labels(self, post):
        """Names of all such quantities at this position."""
        if self.kind == "scalar":
            return [post.element_scalar_label(k) for k in range(post.element_scalars())]
        return [post.element_tensor_label(k) for k in range(post.element_tensors())]

    def index(self, post):
        """Which of them it is, or None."""
        for index, label in enumerate(self.labels(post)):
            if label.strip().lower() == self.label.strip().lower():
                return index
        return None

    def entries(self, post, element, index):
        """Node number and components, as py_post extrapolated them."""
        if self.kind == "scalar":
            found = post.element_scalar(element, index)
            return [(entry.id, (entry.value,)) for entry in found]
        found = post.element_tensor(element, index)
        return [(entry.id, tuple(getattr(entry, name) for name in TENSOR)) for entry in found]

    def stress(self, means):
        """Make one number of the mean components; of a tensor its von Mises stress."""
        if self.kind == "scalar":
            return means[0]
        xx, yy, zz, xy, yz, zx = means
        normal = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
        return math.sqrt(0.5 * normal + 3.0 * (xy**2 + yz**2 + zx**2))


class Neighbourhood:
    """The elements, by index, at each wanted node; all nodes where `nodes` is None."""

    def __init__(self, post, nodes, within):
        self.count, self.nodes, self.within = post.elements(), nodes, within
        members = None if within is None else set(set_named(post, within, "element"))
        wanted = None if nodes is None else set(nodes)
        self.elements = []
        for index in range(self.count):
            here = set(post.element(index).items)
            if wanted is not None:
                here &= wanted
            if here and (members is None or post.element_id(index) in members):
                self.elements.append((index, here))

    def holds(self, post):
        """Whether the elements are still these: not after a remeshing."""
        return post.elements() == self.count and all(
            here.issubset(post.element(index).items) for index, here in self.elements
        )


class Member:
    """A node, an element, a set or a value, as py_post has them."""

    def __init__(self, **given):
        self.__dict__.update(given)


class OdbPost:
    """An .odb of Abaqus, asked as py_post is: position 0 is the model, then every frame.

    The first frame of a later step repeats the last of the one before and is left out.
    """

    def __init__(self, odb, element_nodal, instance):
        self._odb, self._element_nodal = odb, element_nodal
        instances = odb.rootAssembly.instances
        names = sorted(instances.keys())
        if instance is None and len(names) == 1:
            instance = names[0]
        if instance not in names:
            raise ExportError("which part? --instance one of %s" % (", ".join(names) or "none"))
        self._name, self._instance = instance, instances[instance]
        self._elements = list(self._instance.elements)
        self._nodes = list(self._instance.nodes)
        self._row = {node.label: row for row, node in enumerate(self._nodes)}
        self._frames = []
        for step in odb.steps.values():
            for frame in list(step.frames)[1 if self._frames else 0 :]:
                self._frames.append((step, frame))
        self._sets = []
        for holder in (self._instance, odb.rootAssembly):
            for kind, sets in (("node", holder.nodeSets), ("element", holder.elementSets)):
                for name in sets.keys():
                    items = self._members(sets[name], kind + "s")
                    self._sets.append(Member(name=name, type=kind, items=items))
        self.moveto(0)

    def _members(self, one, what):
        """Labels of the members that are of the chosen part: a set may have several."""
        found = getattr(one, what) or ()
        labels = []
        for place, entry in enumerate(found):
            if hasattr(entry, "label"):
                labels.append(entry.label)
            elif one.instanceNames[place] == self._name:
                labels += [member.label for member in entry]
        return labels

    def increments(self):
        """The positions there are."""
        return len(self._frames) + 1

    def moveto(self, position):
        """Go to a position."""
        self._frame, self.time, self.increment = None, 0.0, -1
        if position:
            step, self._frame = self._frames[position - 1]
            self.time = step.totalTime + self._frame.frameValue
            self.increment = self._frame.incrementNumber

    def extrapolation(self, method):
        """Abaqus has one way."""
        if method != "linear":
            raise ExportError("--extrapolate is of Marc: Abaqus extrapolates in one way")

    def elements(self):
        """How many elements there are."""
        return len(self._elements)

    def element(self, index):
        """An element's nodes."""
        return Member(items=list(self._elements[index].connectivity))

    def element_id(self, index):
        """An element's number."""
        return self._elements[index].label

    def node(self, row):
        """A node's place."""
        return Member(**dict(zip("xyz", self._nodes[row].coordinates)))

    def node_sequence(self, number):
        """The row of a node, -1 where it is absent."""
        return self._row.get(number, -1)

    def sets(self):
        """How many sets there are."""
        return len(self._sets)

    def set(self, k):
        """A set."""
        return self._sets[k]

    def _has_stress(self):
        return int(self._frame is not None and "S" in self._frame.fieldOutputs.keys())

    element_tensors = element_scalars = _has_stress

    def element_tensor_label(self, k):
        """The one tensor: S."""
        return LABELS["tensor"]

    def element_scalar_label(self, k):
        """Its von Mises stress, at the nodes of each element."""
        return LABELS["scalar"]

    def _values(self, index):
        region, field = self._elements[index], self._frame.fieldOutputs["S"]
        return field, field.getSubset(region=region, position=self._element_nodal).values

    def element_scalar(self, index, k):
        """Von Mises stress at an element's nodes."""
        return [Member(id=one.nodeLabel, value=one.mises) for one in self._values(index)[1]]

    def element_tensor(self, index, k):
        """Stress at an element's nodes; a plane element has no 13 and 23."""
        field, values = self._values(index)
        found = []
        for one in values:
            try:
                data = one.data
            except Exception:  # in double precision, Abaqus wants it by another name
                data = one.dataDouble
            held = {"t" + name[1:]: float(x) for name, x in zip(field.componentLabels, data)}
            whole = {name: held.get(name, 0.0) for name in TENSOR}
            found.append(Member(id=one.nodeLabel, **whole))
        return found

    def close(self):
        """Close the file."""
        self._odb.close()


def main(words=None):
    """Run; give the exit code: 0 done, 1 our error. Misuse leaves with 2."""
    args = parsed(words)
    try:
        abaqus = args.post_file.lower().endswith(".odb")
        post = opened_odb(args) if abaqus else opened(args.post_file, args.mentat)
        try:
            show(post) if args.list else export(post, args)
        finally:
            post.close()
    except ExportError as error:
        print("export.py: %s" % error, file=sys.stderr)
        return 1
    return 0


def export(post, args):
    """Read the traces and write the table."""
    quantity = Quantity(args.von_mises, args.label)
    post.extrapolation(args.extrapolate)
    start = first_position(post, quantity)
    places = chosen_places(post, args, quantity)
    nodes = sorted({node for _, node in places})
    around = Neighbourhood(post, nodes, args.within)
    if args.within is None:
        note_borders(post, around, nodes)
    times_ms, stress = [], {node: [] for node in nodes}
    for position in range(start, post.increments()):
        moved(post, position)
        if not around.holds(post):
            around = Neighbourhood(post, nodes, args.within)
            note(
                "position %d has another mesh: from there on the numbers of nodes may "
                "stand for other places" % position
            )
        times_ms.append(1000.0 * post.time)
        found = sample(post, around, quantity, "position %d" % position)
        for node in nodes:
            stress[node].append(found[node] * PA_PER_UNIT[args.unit])
    check_steps(times_ms)
    stem = os.path.splitext(os.path.basename(args.post_file))[0]
    output = args.output or stem + "_traces.csv"
    rows = [COLUMNS]
    rows += [
        "%.7g,%s,%d,%.9g" % (time_ms, afferent, node, value)
        for afferent, node in places
        for time_ms, value in zip(times_ms, stress[node])
    ]
    write(output, "\n".join(rows) + "\n")
    print("%s: %d traces, %d times" % (output, len(places), len(times_ms)))


def sample(post, around, quantity, where):
    """Stress at each node of `around`, here, in the file's unit."""
    index = quantity.index(post)
    if index is None:
        raise ExportError("%s: no %s here" % (where, quantity.label))
    found = {node: [] for node in around.nodes}
    for element, here in around.elements:
        for node, components in quantity.entries(post, element, index):
            if node in here:
                found[node].append(components)
    stress = {}
    for node, values in found.items():
        if not values:
            raise ExportError("%s: %s" % (where, why_none(post, around, node)))
        means = [sum(column) / len(values) for column in zip(*values)]
        stress[node] = quantity.stress(means)
        if stress[node] - stress[node] != 0:
            raise ExportError("%s: node %d: %r" % (where, node, stress[node]))
    return stress


def first_position(post, quantity):
    """Go to the first position with results of `quantity`; position 0 is the model."""
    for position in range(1, min(3, post.increments())):
        moved(post, position)
        if quantity.index(post) is not None:
            if position > 1:
                note("the first increment holds no %s: left out" % quantity.label)
            return position
    if post.increments() < 2:
        raise ExportError("the file holds a model and no results")
    other = Quantity("tensor" if quantity.kind == "scalar" else "scalar", None)
    hint = "--von-mises %s would find %s" % (other.kind, other.label)
    raise ExportError(
        "no element %s %r in it; there is %s%s"
        % (
            quantity.kind,
            quantity.label,
            ", ".join(quantity.labels(post)) or "none",
            "" if other.index(post) is None else "; " + hint,
        )
    )


def chosen_places(post, args, quantity):
    """Afferent ("" for none) and node number, each pair once."""
    nodes = list(args.nodes)
    for name in args.set:
        nodes += set_named(post, name, "node")
    if args.near:
        around = Neighbourhood(post, None, args.within)
        nodes += [nearest(post, place, around, quantity) for place in args.near]
    places = list(args.afferent)
    taken = {node for _, node in places}
    places += [("", node) for node in nodes if node not in taken]
    for _, node in places:
        if post.node_sequence(node) < 0:
            raise ExportError("no node %d in the model" % node)
    return [place for at, place in enumerate(places) if place not in places[:at]]


def nearest(post, place, around, quantity):
    """The node nearest to `place` at which an element has a value."""
    first = {}
    for element, here in around.elements:
        for node in here:
            first.setdefault(node, element)
    ranked = []
    for node, element in first.items():
        point = post.node(post.node_sequence(node))
        away = zip((point.x, point.y, point.z), place)
        ranked.append((math.sqrt(sum((a - b) ** 2 for a, b in away)), node, element))
    index = quantity.index(post)
    for distance, node, element in sorted(ranked):
        if any(at == node for at, _ in quantity.entries(post, element, index)):
            note("near %s: node %d, %.4g away" % (place, node, distance))
            return node
    raise ExportError("no node with a value near %s" % (place,))


def set_named(post, name, kind):
    """Members of a set of nodes or of elements."""
    held = [post.set(k) for k in range(post.sets())]
    for each in held:
        if each.name.strip() == name and each.type == kind:
            return list(each.items)
    names = ", ".join(each.name.strip() for each in held if each.type == kind)
    raise ExportError("no %s set %r; there is %s" % (kind, name, names or "none"))


def why_none(post, around, node):
    """Why there is no value at a node."""
    elements = [post.element_id(k) for k, here in around.elements if node in here]
    if elements:
        return "node %d has no value in element %d: a pressure node?" % (node, elements[0])
    inside = "" if around.within is None else " of the set %s" % around.within
    return "node %d belongs to no element%s" % (node, inside)


def note_borders(post, around, nodes):
    """Note where the mean is over elements of different sets: layers, by all signs."""
    held = [post.set(k) for k in range(post.sets())]
    held = [(s.name.strip(), set(s.items)) for s in held if s.type == "element"]
    for node in nodes:
        sides = set()
        for index, here in around.elements:
            if node in here:
                number = post.element_id(index)
                sides.add(tuple(name for name, items in held if number in items))
        if len(sides) > 1:
            words = " | ".join(sorted(" + ".join(names) or "none" for names in sides))
            note(
                "node %d: its elements are in different sets, %s; the mean is over "
                "all of them, --within SET takes one side" % (node, words)
            )


def check_steps(times_ms):
    """Refuse times that do not rise; say when their step is uneven."""
    if len(times_ms) < 2:
        raise ExportError("one time with results, a trace needs two or more")
    mean = (times_ms[-1] - times_ms[0]) / (len(times_ms) - 1)
    for row in range(1, len(times_ms)):
        before, after = times_ms[row - 1], times_ms[row]
        if after <= before:
            raise ExportError("time does not rise: %g, %g ms" % (before, after))
        if abs(after - before - mean) > STEP_TOLERANCE * mean:
            note(
                "uneven time step, %g to %g ms where %g ms is the mean: fembridge "
                "encode refuses such a table; run with fixed increments" % (before, after, mean)
            )
            return


def show(post):
    """Print what the file holds."""
    count = post.increments()
    print("positions with results: %d" % (count - 1))
    for position in sorted({min(1, count - 1), count - 1}):
        moved(post, position)
        print("  %d: increment %s, %g s" % (position, post.increment, post.time))
    for kind in ("scalar", "tensor"):
        print("element %ss: %s" % (kind, ", ".join(Quantity(kind, None).labels(post))))
    for each in (post.set(k) for k in range(post.sets())):
        print("%s set %s: %d" % (each.type, each.name.strip(), len(each.items)))


def moved(post, position):
    """Go to a position."""
    try:
        post.moveto(position)
    except Exception as error:  # whatever py_post raises: it is not documented
        raise ExportError("position %d cannot be read: %s" % (position, error))


def opened(path, mentat):
    """Import py_post and open the post file with it."""
    if not os.path.isfile(path):
        raise ExportError("no such file: %s" % path)
    for folder, _, names in os.walk(os.path.join(mentat, "shlib") if mentat else ""):
        if any(name.startswith("py_post.") for name in names):
            sys.path.insert(0, folder)
            if hasattr(os, "add_dll_directory"):
                os.add_dll_directory(folder)
    try:
        import py_post
    except ImportError as error:
        version = "%d.%d" % sys.version_info[:2]
        raise ExportError(NO_PY_POST % (version, sys.executable, error))
    try:
        post = py_post.post_open(path)
    except Exception as error:  # whatever py_post raises: it is not documented
        raise ExportError("py_post cannot open %s: %s" % (path, error))
    if post is None:
        raise ExportError("py_post cannot open %s" % path)
    return post


def opened_odb(args):
    """Import odbAccess and open the .odb with it."""
    if not os.path.isfile(args.post_file):
        raise ExportError("no such file: %s" % args.post_file)
    try:
        from abaqusConstants import ELEMENT_NODAL
        from odbAccess import openOdb
    except ImportError as error:
        version = "%d.%d" % sys.version_info[:2]
        raise ExportError(NO_ABAQUS % (version, sys.executable, error))
    try:
        odb = openOdb(args.post_file, readOnly=True)
    except Exception as error:  # OdbError, a lock, another release
        raise ExportError("Abaqus cannot open %s: %s" % (args.post_file, error))
    return OdbPost(odb, ELEMENT_NODAL, args.instance)


def write(path, text):
    """Write the table beside its name, then rename: whole or not at all."""
    draft = "%s.%d.part" % (path, os.getpid())
    try:
        with open(draft, "wb") as file:
            file.write(text.encode("ascii"))
        if not hasattr(os, "replace") and os.name == "nt" and os.path.exists(path):
            os.remove(path)  # Python 2 on Windows cannot rename over a file
        getattr(os, "replace", os.rename)(draft, path)
    except (IOError, OSError) as error:
        if os.path.exists(draft):
            os.remove(draft)
        raise ExportError("cannot write %s: %s" % (path, error.strerror))


def note(words):
    """Print a remark."""
    print("note: %s" % words, file=sys.stderr)


def afferent(text):
    """Read ``SA=4711``."""
    name, _, node = text.partition("=")
    if name not in AFFERENTS:
        raise argparse.ArgumentTypeError("%r is none of %s" % (name, ", ".join(AFFERENTS)))
    return name, int(node)


def place(text):
    """Read ``X,Y`` or ``X,Y,Z``."""
    values = tuple(float(word) for word in text.split(","))
    if len(values) not in (2, 3):
        raise ValueError(text)
    return values


def parsed(given):
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("post_file", metavar="POST", help="a .t16 or .t19 of Marc, an .odb of Abaqus")
    add("-o", "--output", metavar="FILE", help="table (default: POST_traces.csv here)")
    add("--list", action="store_true", help="show what the file holds, write nothing")
    for word, kind, shown, words in (
        ("nodes", int, "N", "nodes by number"),
        ("afferent", afferent, "CLASS=N", "the node of an afferent: SA=4711 RA=4712"),
        ("set", str, "NAME", "all nodes of a set"),
        ("near", place, "X,Y[,Z]", "the nearest node with values; below zero --near=-1,2"),
    ):
        several = {"nargs": "+", "action": "append", "default": []}
        add("--" + word, type=kind, metavar=shown, help=words, **several)
    add("--within", metavar="SET", help="only elements of this set: one layer")
    add(
        "--von-mises",
        choices=("tensor", "scalar"),
        default="tensor",
        help="tensor: of the extrapolated stress, as fembridge ingest has it; scalar: "
        "the post file's own (code 17), extrapolated, as Mentat plots it (default: "
        "tensor)",
    )
    add(
        "--label",
        help="its name in the post file (default: %(scalar)s, or, for a "
        "tensor, %(tensor)s)" % LABELS,
    )
    add(
        "--extrapolate",
        choices=("linear", "translate", "average"),
        default="linear",
        help="what py_post does from integration points to nodes (default: linear)",
    )
    add("--unit", choices=sorted(PA_PER_UNIT), default="MPa", help="of the stress")
    add("--instance", metavar="NAME", help="of an .odb with several parts: whose nodes")
    add("--mentat", metavar="FOLDER", help="Mentat's folder, if py_post is not found")
    args = parser.parse_args(given)
    for name in ("nodes", "afferent", "set", "near"):
        setattr(args, name, [each for group in getattr(args, name) for each in group])
    if not (args.nodes or args.afferent or args.set or args.near or args.list):
        parser.error("choose --nodes, --afferent, --set or --near; or --list")
    return args


if __name__ == "__main__":
    sys.exit(main())
