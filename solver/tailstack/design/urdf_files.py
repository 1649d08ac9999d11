"""URDF files: the joints from a base link to a tip link, as ``execution.robot.joints`` has them.

Of the format (ROS, wiki.ros.org/urdf/XML/joint) are read: ``joint`` with ``parent``, ``child``, ``origin`` (xyz in m,
rpy in rad: ``Rz(yaw) Ry(pitch) Rx(roll)``) and ``axis``.  Links' shapes, masses and limits are left alone.  A document
type, where entities could be declared, is refused before anything is parsed.

Kept readers were tried: urdf_parser_py takes floating joints, nan and an axis of 0 as they come, and does not return
from a circle of joints; yourdfpy brings 27 packages, 380 MB.
"""

from __future__ import annotations

from math import degrees
from xml.etree import ElementTree

from pydantic import ValidationError

from ..effects.robot import MOST_LINKS, ArmJoint, UrdfChain
from ..errors import DesignError, Problem
from .reading import decode
from .refusals import describe_value

ENDING = ".urdf"
MOST_BYTES = 2_000_000
_KINDS = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic", "fixed": "fixed"}


def _refuse(name: str, code: str, detail: str, cure: str = "", line: int | None = None) -> DesignError:
    return DesignError(Problem("", code, detail, cure, name, line))


def read_urdf(content: bytes, chain: UrdfChain) -> list[ArmJoint]:
    """The joints from the base link to the tip, mm and degrees.  Raises DesignError."""
    name = chain.file
    text = decode(content, name)
    if "<!DOCTYPE" in text:
        raise _refuse(name, "xml-doctype", "a document type is not read here", "take <!DOCTYPE ...> out")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise _refuse(name, "xml-syntax", str(error), "save it as URDF (XML)", error.position[0]) from None
    if root.tag != "robot":
        raise _refuse(name, "unknown-format", f"a URDF file begins with <robot>; got <{root.tag[:40]}>")
    if any("xacro}" in each.tag for each in root.iter()):
        raise _refuse(name, "xacro", "it is a xacro file, not yet a robot", "xacro FILE.xacro > FILE.urdf")
    above: dict[str, tuple[str, ElementTree.Element]] = {}  # by link: the link before it, and the joint between
    for joint in root.findall("joint"):
        parent, child = (_attribute(joint, tag, "link", name) for tag in ("parent", "child"))
        if child in above:
            raise _refuse(name, "urdf-tree", f"link {child!r:.60} hangs on two joints")
        above[child] = parent, joint
    ends = sorted(above.keys() - {parent for parent, _ in above.values()})
    link = chain.tip_link or (ends[0] if len(ends) == 1 else "")
    if link not in above:
        what = f"no joint carries the link {link!r:.60}" if link else f"{len(ends)} links are ends of it"
        raise _refuse(name, "unknown-link", what, f"tip_link: one of {', '.join(ends[:8]) or 'none'}")
    found: list[ArmJoint] = []
    while link in above and link != chain.base_link:
        link, joint = above[link]
        found.insert(0, _read_joint(joint, name))
        if len(found) > MOST_LINKS:
            detail = f"more than {MOST_LINKS} joints between base and tip, or a circle of them"
            raise _refuse(name, "too-many", detail, "name a nearer base_link")
    if chain.base_link not in (None, link):
        raise _refuse(name, "unknown-link", f"the tip does not hang on {chain.base_link!r}", f"base_link: {link}")
    return found


def _attribute(joint: ElementTree.Element, tag: str, field: str, name: str, default: str | None = None) -> str:
    below = joint.find(tag)
    value = default if below is None else below.get(field, default)
    if value is None:
        raise _refuse(name, "missing-field", f"joint {joint.get('name')!r:.60} has no <{tag} {field}=...>")
    return value


def _numbers(joint: ElementTree.Element, tag: str, field: str, default: str, name: str) -> list[float]:
    text = _attribute(joint, tag, field, name, default)
    try:
        x, y, z = map(float, text.split())
    except ValueError:
        which = f"<{tag} {field}> of joint {joint.get('name')!r:.60}"
        raise _refuse(name, "wrong-type", f"{which} is three numbers; got {text!r:.60}") from None
    return [x, y, z]


def _read_joint(joint: ElementTree.Element, file: str) -> ArmJoint:
    name, kind = joint.get("name", ""), joint.get("type", "")
    if kind not in _KINDS or joint.find("mimic") is not None:
        what = f"type {kind!r:.60}" if kind not in _KINDS else "<mimic>"
        read = ", ".join(_KINDS)
        raise _refuse(file, "unknown-joint", f"joint {name!r:.60} has {what}", f"joints that are read: {read}")
    stated = {"name": name, "type": _KINDS[kind], "axis": _numbers(joint, "axis", "xyz", "1 0 0", file)}
    stated["xyz_mm"] = [1e3 * each for each in _numbers(joint, "origin", "xyz", "0 0 0", file)]
    stated["rpy_deg"] = [degrees(each) for each in _numbers(joint, "origin", "rpy", "0 0 0", file)]
    if kind == "fixed":
        del stated["axis"]
    try:
        return ArmJoint.model_validate(stated)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        at = " ".join(["joint", repr(name)[:60], *map(str, first["loc"][:1])])
        said = describe_value(first, first["loc"])
        raise _refuse(file, "wrong-joint", f"{at}: {said.detail}", said.hint or "xyz is in m, rpy in rad") from None
