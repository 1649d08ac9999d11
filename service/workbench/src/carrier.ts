// The surface that beads are dragged on: the mesh of a dropped file, in con, for as long as the page is open.

import { batch, computed, effect, signal } from "@preact/signals";
import { onSurface } from "./acts";
import { dropped } from "./api";
import { movingTo, nameOf, rules, stopped } from "./beads";
import { add, length, type Vector } from "./geometry";
import { breaches } from "./keeping";
import { cast, type Mesh, meshOf, readStl, touch, type Tree, treeOf, walk } from "./mesh";
import { base64, design, type Edit, say, settled, through } from "./state";
import { brief } from "./words";

const LARGEST = 64; // MB of a file
export const UNITS: Record<string, number> = { mm: 1, cm: 10, m: 1000, in: 25.4 };
const BEAD_MM = 3; // diameter, where the design states none: that localisation noise is quoted for

interface Carrier {
  name: string;
  mesh: Mesh; // in the file's unit
  unit: string;
}
export const carrier = signal<Carrier | null>(null);
export const snaps = signal(true);
export const radius = computed(() => (typeof design.value?.fiducials?.diameter_mm === "number" ? design.value.fiducials.diameter_mm : BEAD_MM) / 2);

/** The surface in mm. */
export const surface = computed<Tree | null>(() => {
  if (!carrier.value) return null;
  const { mesh, unit } = carrier.value, factor = UNITS[unit];
  return treeOf(factor === 1 ? mesh : meshOf(mesh.corners.map((value) => factor * value)));
});

export const sizeOf = ({ mesh, unit }: Carrier) => `${[0, 1, 2].map((k) => brief(UNITS[unit] * (mesh.high[k] - mesh.low[k]))).join(" × ")} mm`;

const MOST_PACKED = 450_000; // bytes of a file in a request, as the service packs one

/** Take the surface of an STL file. */
export async function takeSurface(file: File): Promise<void> {
  if (file.size > 1e6 * LARGEST) return say(`${file.name} has ${Math.round(file.size / 1e6)} MB; surfaces of at most ${LARGEST} MB are read: export it coarser`, true);
  try {
    const bytes = await file.arrayBuffer(), mesh = readStl(bytes), packed = await through(new Uint8Array(bytes), new CompressionStream("gzip"));
    batch(() => {
      carrier.value = { name: file.name, mesh, unit: "mm" };
      dropped.value = { file: file.name, content: packed.length > MOST_PACKED ? "" : base64(packed) };
    });
    say(`The surface of ${file.name} is in the drawing in space: beads that are dragged there touch it, and Optimise puts them on it where you say so above the pictures. It states no unit and no frame: mm and con are assumed.`);
  } catch (error) {
    say(`${file.name}: ${(error as Error).message}`, true);
  }
}

export function removeSurface(): void {
  carrier.value = dropped.value = null;
}

effect(() => {
  carrier.value; // another surface, or unit, or none
  radius.value;
  onSurface.value = null;
});
const THINNEST = 0.5; // mm, that a layer on both sides is
/** From now on an optimisation puts beads where they touch the surface on one of its sides, or on both; "": as the design says. */
export function optimiseOnIt(side: string): void {
  const { name, unit } = carrier.value!, away = radius.value;
  if (side && !dropped.value!.content) return say(`${name} is too large to be sent to the service: export it coarser`, true);
  onSurface.value = side && { file: name, unit, distance_mm: side === "both" ? Math.max(away, THINNEST) : away, at_least_mm: away, side };
}

const ROUNDS = 60, DIGITS = 5, NEAR = 1e-4; // mm

/** Edits that bring a bead to a place where it touches the surface, and keeps what is kept: both in turns, until both hold. */
export function touching(label: string, place: Vector): Edit[] | null {
  const tree = surface.value!;
  for (let k = 0, at = place; k < ROUNDS; k += 1) {
    const edits = movingTo(label, at, DIGITS), own = edits?.find(({ path }) => labelAt(path) === label)?.value as Vector | undefined;
    if (!edits || !own) return null;
    const next = touch(tree, own, radius.value);
    if (length(add(next, own, -1)) < NEAR) return resting(edits, tree);
    at = next;
  }
  stopped.value = "off the surface, with what is locked and kept";
  return null;
}

const labelAt = ([, , index]: Edit["path"]) => nameOf(settled.value.fiducials.points[index], index as number);

/** What is moved with a bead touches the surface, too, unless that breaks what is kept. */
function resting(edits: Edit[], tree: Tree): Edit[] | null {
  if (edits.length === 1) return edits;
  const made = edits.map(({ path, value }) => ({ path, value: touch(tree, value, radius.value).map((v) => Number(v.toFixed(DIGITS))) as Vector, label: labelAt(path) }));
  const broken = made.flatMap(({ value, label }) => breaches(value, made.filter((other) => other.label !== label).map((other) => ({ label: other.label, position: other.value })), rules.value));
  if (broken.length) stopped.value = broken[0].words;
  return broken.length ? null : made.map(({ path, value }) => ({ path, value }));
}

/** Where a ball comes to touch that flies along a line of sight; and where one comes from a place by a step. */
export const seenAt = (through: Vector, sight: Vector): Vector => cast(surface.value!, through, sight, radius.value);
export const stepped = (from: Vector, step: Vector): Vector => walk(surface.value!, from, step, radius.value);
