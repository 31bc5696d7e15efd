# Runs in the Python of Mentat or Abaqus, 2.7 or 3.6 and later, with its standard library alone.
# ruff: noqa: ANN001, ANN201, ANN202, ANN204, SIM118, B904, B905, PTH107, PTH110, PTH113, PTH118
# ruff: noqa: PTH119, PTH122, PTH123, UP004, UP010, UP024, UP031
# mypy: ignore-errors
"""Write von Mises stress at nodes of a Marc post file or an Abaqus .odb as a table for fembridge.

    python export.py job.t16 --list
    python export.py job.t16 --afferent SA=4711 RA=4712 PC=88 -o traces.csv
    python export.py job.t16 --near 0.4,-1.2 --within dermis_elements -o traces.csv
    abaqus python export.py job.odb --afferent SA=4711 -o traces.csv

The script runs in the Python of Mentat with py_post, or in that of Abaqus with odbAccess; no
window opens. "fembridge encode" reads the table, time_ms,afferent,node,von_mises_pa. A value at a
node is the mean over its elements of the value that py_post or Abaqus (ELEMENT_NODAL) extrapolates
to it. Neither has units: time is taken as s, stress in --unit. Written from descriptions of
py_post and odbAccess (Abaqus Scripting Reference, "Odb commands") and tested with imitations of
them, not in Mentat or Abaqus.
"""

from __future__ import division, print_function

import argparse
import math
import os
import sys

AFFERENTS = ("SA", "RA", "PC")
COLUMNS = "time_ms,afferent,node,von_mises_pa"
PA_PER_UNIT = {"MPa": 1.0e6, "kPa": 1.0e3, "Pa": 1.0}
LABELS = {"scalar": "Equivalent Von Mises Stress", "tensor": "Stress"}
TENSOR = ("t11", "t22", "t33", "t12", "t23", "t13")

NO_PY_POST = """this Python, %s (%s), cannot import py_post: %s
Run this file with the Python of Mentat, on Windows for instance
  "C:\\Program Files\\MSC.Software\\Marc\\2024.1.0\\mentat2024.1\\python\\WIN8664\\\
python.exe" export.py ...
If it does not find py_post either, name the folder of Mentat:
  --mentat "C:\\Program Files\\MSC.Software\\Marc\\2024.1.0\\mentat2024.1\""""


NO_ABAQUS = """this Python, %s (%s), cannot import odbAccess: %s
Run this file with the Python of Abaqus:
  abaqus python export.py job.odb ..."""


class ExportError(Exception):
    """A problem that prevents the table; the message is for the user."""


class Marc(object):
    """A post file, read by py_post: position 0 is the model without results.

    `elements` are the nodes of each element, `sets` the name, kind and members of each set,
    `positions` the number of positions. The exceptions of py_post are not documented.
    """

    def __init__(self, args):
        path = args.post_file
        for folder, _, names in os.walk(os.path.join(args.mentat, "shlib") if args.mentat else ""):
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
        except Exception as error:
            raise ExportError("py_post cannot open %s: %s" % (path, error))
        if post is None:
            raise ExportError("py_post cannot open %s" % path)
        self._post = post
        post.extrapolation(args.extrapolate)
        self.positions = post.increments()
        self.go_to(min(1, self.positions - 1))
        self.read_mesh()
        sets = [post.set(k) for k in range(post.sets())]
        self.sets = [(entry.name.strip(), entry.type, list(entry.items)) for entry in sets]
        self.close = post.close

    def read_mesh(self):
        """Read the elements of this position."""
        post = self._post
        numbers = [post.element_id(k) for k in range(post.elements())]
        self._index = {number: k for k, number in enumerate(numbers)}
        self.elements = {n: list(post.element(k).items) for n, k in self._index.items()}

    def has_elements(self, around):
        """Whether the elements are unchanged; False after a remeshing."""
        return self._post.elements() == len(self.elements) and all(
            node_set.issubset(self._post.element(self._index[number]).items)
            for number, node_set in around.items()
        )

    def go_to(self, position):
        """Go to a position; return its increment and time."""
        try:
            self._post.moveto(position)
        except Exception as error:
            raise ExportError("position %d cannot be read: %s" % (position, error))
        return self._post.increment, self._post.time

    def coordinates(self, node):
        """Coordinates of a node; None if it is missing."""
        row = self._post.node_sequence(node)
        if row < 0:
            return None
        point = self._post.node(row)
        return point.x, point.y, point.z

    def value_labels(self, kind):
        """Names of the element scalars or tensors at this position."""
        post = self._post
        if kind == "scalar":
            return [post.element_scalar_label(k) for k in range(post.element_scalars())]
        return [post.element_tensor_label(k) for k in range(post.element_tensors())]

    def values(self, element, kind, index):
        """Nodes of an element, and the components that py_post extrapolates to them."""
        row = self._index[element]
        if kind == "scalar":
            return [(entry.id, (entry.value,)) for entry in self._post.element_scalar(row, index)]
        tensors = self._post.element_tensor(row, index)
        return [(entry.id, tuple(getattr(entry, name) for name in TENSOR)) for entry in tensors]


class Abaqus(object):
    """An .odb, read by odbAccess, as `Marc`: position 0 is the model, then every frame.

    The first frame of a later step repeats the last frame of the previous step and is left out.
    """

    def __init__(self, args):
        path, name = args.post_file, args.instance
        if args.extrapolate != "linear":
            raise ExportError("--extrapolate is for Marc: Abaqus has one method")
        try:
            from abaqusConstants import ELEMENT_NODAL
            from odbAccess import openOdb
        except ImportError as error:
            version = "%d.%d" % sys.version_info[:2]
            raise ExportError(NO_ABAQUS % (version, sys.executable, error))
        try:
            odb = openOdb(path, readOnly=True)
        except Exception as error:  # OdbError, a lock, another release
            raise ExportError("Abaqus cannot open %s: %s" % (path, error))
        instances = odb.rootAssembly.instances
        names = sorted(instances.keys())
        if name is None and len(names) == 1:
            name = names[0]
        if name not in names:
            raise ExportError("choose a part, --instance: %s" % (", ".join(names) or "none"))
        part, self._element_nodal, self.close = instances[name], ELEMENT_NODAL, odb.close
        self._elements_by_label = {element.label: element for element in part.elements}
        self.elements = {element.label: list(element.connectivity) for element in part.elements}
        self._coordinates = {node.label: tuple(node.coordinates) for node in part.nodes}
        self._frames = [None]
        for step in odb.steps.values():
            for frame in list(step.frames)[1 if len(self._frames) > 1 else 0 :]:
                self._frames.append((step.totalTime + frame.frameValue, frame))
        self.positions = len(self._frames)
        self.sets = []
        for owner in (part, odb.rootAssembly):
            for kind, sets in (("node", owner.nodeSets), ("element", owner.elementSets)):
                for key in sets.keys():
                    self.sets.append((key, kind, self._members(sets[key], kind + "s", name)))

    def _members(self, group, attribute, name):
        """Labels of the members of a set in the chosen part; a set may have several parts."""
        labels = []
        for index, entry in enumerate(getattr(group, attribute) or ()):
            if hasattr(entry, "label"):
                labels.append(entry.label)
            elif group.instanceNames[index] == name:
                labels += [member.label for member in entry]
        return labels

    def has_elements(self, around):
        """True: all frames have one mesh."""
        return True

    def go_to(self, position):
        """Go to a position; return its increment and time."""
        time_s, self._frame = self._frames[position] if position else (0.0, None)
        return self._frame.incrementNumber if position else -1, time_s

    def coordinates(self, node):
        """Coordinates of a node; None if it is missing."""
        return self._coordinates.get(node)

    def value_labels(self, kind):
        """Name of the stress S, which has a tensor and its von Mises stress."""
        has_stress = self._frame is not None and "S" in self._frame.fieldOutputs.keys()
        return [LABELS[kind]] if has_stress else []

    def values(self, element, kind, index):
        """Nodes of an element, and stress at them; a plane element has no 13 and 23."""
        field, values = self._frame.fieldOutputs["S"], []
        region, position = self._elements_by_label[element], self._element_nodal
        for value in field.getSubset(region=region, position=position).values:
            if kind == "scalar":
                values.append((value.nodeLabel, (value.mises,)))
                continue
            try:
                data = value.data
            except Exception:  # in double precision the attribute has another name
                data = value.dataDouble
            by_component = {
                "t" + name[1:]: float(x) for name, x in zip(field.componentLabels, data)
            }
            values.append((value.nodeLabel, tuple(by_component.get(name, 0.0) for name in TENSOR)))
        return values


def main(arguments=None):
    """Run; return the exit code: 0 done, 1 error. Misuse exits with 2."""
    args = parse_arguments(arguments)
    try:
        if not os.path.isfile(args.post_file):
            raise ExportError("no such file: %s" % args.post_file)
        post = (Abaqus if args.post_file.lower().endswith(".odb") else Marc)(args)
        try:
            print_contents(post) if args.list else export(post, args)
        finally:
            post.close()
    except ExportError as error:
        print("export.py: %s" % error, file=sys.stderr)
        return 1
    return 0


def export(post, args):
    """Read the traces and write the table."""
    kind, label = args.von_mises, args.label or LABELS[args.von_mises]
    start = first_position(post, kind, label)
    places = choose_nodes(post, args, kind, label)
    nodes = sorted({node for _, node in places})
    around = find_elements(post, nodes, args.within)
    if args.within is None:
        note_borders(post, around, nodes)
    times_ms, stress = [], {node: [] for node in nodes}
    for position in range(start, post.positions):
        times_ms.append(1000.0 * post.go_to(position)[1])
        if times_ms[1:] and times_ms[-1] <= times_ms[-2]:
            raise ExportError("time does not increase: %g, %g ms" % tuple(times_ms[-2:]))
        if not post.has_elements(around):
            post.read_mesh()
            around = find_elements(post, nodes, args.within)
            note(
                "position %d has another mesh: from there on node numbers may mean other "
                "positions" % position
            )
        for node, value in sample(post, around, nodes, kind, label, position).items():
            stress[node].append(value * PA_PER_UNIT[args.unit])
    if len(times_ms) < 2:
        raise ExportError("one time with results, expected two or more")
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


def find_index(post, kind, label):
    """Index of the scalar or tensor with this name; None if it is missing."""
    names = [name.strip().lower() for name in post.value_labels(kind)]
    return names.index(label.strip().lower()) if label.strip().lower() in names else None


def sample(post, around, nodes, kind, label, position):
    """Von Mises stress at each node at this position, in the unit of the file."""
    index = find_index(post, kind, label)
    if index is None:
        raise ExportError("position %d: no %s" % (position, label))
    components_at = {node: [] for node in nodes}
    for element, node_set in around.items():
        for node, components in post.values(element, kind, index):
            if node in node_set:
                components_at[node].append(components)
    stress = {}
    for node, values in components_at.items():
        if not values:
            elements = [element for element, node_set in around.items() if node in node_set]
            problem = (
                "no value in element %d: a pressure node?" % elements[0]
                if elements
                else "no element"
            )
            raise ExportError("position %d: node %d has %s" % (position, node, problem))
        means = [sum(column) / len(values) for column in zip(*values)]
        stress[node] = means[0] if kind == "scalar" else von_mises(*means)
        if stress[node] - stress[node] != 0:
            raise ExportError("position %d: node %d: %r" % (position, node, stress[node]))
    return stress


def von_mises(xx, yy, zz, xy, yz, zx):
    """Von Mises stress of a tensor."""
    normal = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    return math.sqrt(0.5 * normal + 3.0 * (xy**2 + yz**2 + zx**2))


def find_elements(post, nodes, within):
    """By element: those of `nodes`, or all of its nodes if `nodes` is None."""
    members = None if within is None else set(find_set(post, within, "element"))
    around = {}
    for element, corners in post.elements.items():
        node_set = set(corners) if nodes is None else set(corners).intersection(nodes)
        if node_set and (members is None or element in members):
            around[element] = node_set
    if nodes is not None:
        for node in set(nodes).difference(*around.values() or [()]):
            inside = "" if within is None else " of the set %s" % within
            raise ExportError("node %d belongs to no element%s" % (node, inside))
    return around


def first_position(post, kind, label):
    """Go to the first position with results; position 0 is the model."""
    for position in range(1, min(3, post.positions)):
        post.go_to(position)
        if find_index(post, kind, label) is not None:
            if position > 1:
                note("left out: the first increment, without %s" % label)
            return position
    if post.positions < 2:
        raise ExportError("the file has a model without results")
    names = ", ".join(post.value_labels(kind)) or "none"
    other = "tensor" if kind == "scalar" else "scalar"
    if find_index(post, other, LABELS[other]) is not None:
        names += "; --von-mises %s reads %s" % (other, LABELS[other])
    raise ExportError("no element %s %r; the file has %s" % (kind, label, names))


def choose_nodes(post, args, kind, label):
    """Afferent ("" for none) and node number of each trace, without duplicates."""
    nodes = list(args.nodes)
    for name in args.set:
        nodes += find_set(post, name, "node")
    if args.near:
        around = find_elements(post, None, args.within)
        nodes += [nearest_node(post, point, around, kind, label) for point in args.near]
    places = list(args.afferent)
    named = {node for _, node in places}
    places += [("", node) for node in nodes if node not in named]
    for _, node in places:
        if post.coordinates(node) is None:
            raise ExportError("no node %d in the model" % node)
    return [pair for index, pair in enumerate(places) if pair not in places[:index]]


def nearest_node(post, point, around, kind, label):
    """The node with values that is nearest to `point`."""
    first = {}
    for element, node_set in around.items():
        for node in node_set:
            first.setdefault(node, element)
    ranked = []
    for node, element in first.items():
        axes = zip(post.coordinates(node), point)
        ranked.append((math.sqrt(sum((a - b) ** 2 for a, b in axes)), node, element))
    index = find_index(post, kind, label)
    for distance, node, element in sorted(ranked):
        if any(number == node for number, _ in post.values(element, kind, index)):
            note("near %s: node %d, %.4g away" % (point, node, distance))
            return node
    raise ExportError("no node with a value near %s" % (point,))


def find_set(post, name, kind):
    """Members of a set of nodes or of elements."""
    members = {key: items for key, set_kind, items in post.sets if set_kind == kind}
    if name not in members:
        names = ", ".join(sorted(members)) or "none"
        raise ExportError("no %s set %r; the file has %s" % (kind, name, names))
    return members[name]


def note_borders(post, around, nodes):
    """Note nodes with elements of different sets, which are probably layers."""
    element_sets = [(name, set(items)) for name, kind, items in post.sets if kind == "element"]
    for node in nodes:
        sides = {
            tuple(name for name, items in element_sets if element in items)
            for element, node_set in around.items()
            if node in node_set
        }
        if len(sides) > 1:
            sides_text = " | ".join(sorted(" + ".join(names) or "none" for names in sides))
            note(
                "node %d has elements of different sets, %s; the value is the mean over all, "
                "--within SET takes one set" % (node, sides_text)
            )


def print_contents(post):
    """Print the content of the file."""
    print("positions with results: %d" % (post.positions - 1))
    for position in sorted({min(1, post.positions - 1), post.positions - 1}):
        increment, time_s = post.go_to(position)
        print("  %d: increment %s, %g s" % (position, increment, time_s))
    for kind in ("scalar", "tensor"):
        print("element %ss: %s" % (kind, ", ".join(post.value_labels(kind))))
    for name, kind, items in post.sets:
        print("%s set %s: %d" % (kind, name, len(items)))


def write(path, text):
    """Write the table to a draft, then rename it, so that the file is complete."""
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


def note(message):
    """Print a remark."""
    print("note: %s" % message, file=sys.stderr)


def afferent(text):
    """Read ``SA=4711``."""
    name, _, node = text.partition("=")
    if name not in AFFERENTS:
        raise argparse.ArgumentTypeError("%r is none of %s" % (name, ", ".join(AFFERENTS)))
    return name, int(node)


def position(text):
    """Read ``X,Y`` or ``X,Y,Z``."""
    values = tuple(float(number) for number in text.split(","))
    if len(values) not in (2, 3):
        raise ValueError(text)
    return values


def parse_arguments(arguments):
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("post_file", metavar="POST", help="a .t16 or .t19 of Marc, an .odb of Abaqus")
    add("-o", "--output", metavar="FILE", help="table (default: POST_traces.csv here)")
    add("--list", action="store_true", help="show the content of the file, write nothing")
    for option, kind, metavar, help_text in (
        ("nodes", int, "N", "nodes by number"),
        ("afferent", afferent, "CLASS=N", "the node of an afferent: SA=4711 RA=4712"),
        ("set", str, "NAME", "all nodes of a set"),
        ("near", position, "X,Y[,Z]", "the nearest node with values; below zero --near=-1,2"),
    ):
        several = {"nargs": "+", "action": "append", "default": []}
        add("--" + option, type=kind, metavar=metavar, help=help_text, **several)
    add("--within", metavar="SET", help="only elements of this set: one layer")
    add(
        "--von-mises",
        choices=("tensor", "scalar"),
        default="tensor",
        help="tensor: of the extrapolated stress, as in fembridge ingest; scalar: the "
        "extrapolated scalar of the post file (code 17), as in Mentat's plots (default: tensor)",
    )
    add(
        "--label",
        help="name of the stress in the post file (default: %(scalar)s, or %(tensor)s for a "
        "tensor)" % LABELS,
    )
    add(
        "--extrapolate",
        choices=("linear", "translate", "average"),
        default="linear",
        help="how py_post extrapolates from integration points to nodes (default: linear)",
    )
    add("--unit", choices=sorted(PA_PER_UNIT), default="MPa", help="unit of stress in the file")
    add("--instance", metavar="NAME", help="part of an .odb with several parts")
    add("--mentat", metavar="FOLDER", help="Mentat's folder, if py_post is not found")
    args = parser.parse_args(arguments)
    for name in ("nodes", "afferent", "set", "near"):
        setattr(args, name, [item for group in getattr(args, name) for item in group])
    if not (args.nodes or args.afferent or args.set or args.near or args.list):
        parser.error("choose --nodes, --afferent, --set or --near; or --list")
    return args


if __name__ == "__main__":
    sys.exit(main())
