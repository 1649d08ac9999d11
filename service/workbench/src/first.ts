// The text of a first design about points that are there already, as first_design.py of the service writes it for the
// balls of a STEP file; here the C-arm and the limit are chosen.  It imports nothing but types: a test runs it alone.

import type { components } from "../../../openapi/typescript/tailstack";

export type CArm = components["schemas"]["PresetEntry"];
export interface Point {
  label: string;
  position_mm: number[];
}
/** A C-arm by its lengths, mm, and its image, px; without a name it is one's own. */
export type Lengths = Pick<CArm, "source_detector_mm" | "source_isocentre_mm" | "pixel_mm" | "image_size_px">;
export interface Wishes {
  arm: Lengths & { name?: string; title?: string };
  limit_mm: number;
  stated: ReadonlySet<string>; // what of these was answered: arm, limit_mm, and lengths of one's own C-arm
}
type Length = "source_isocentre_mm" | "pixel_mm";

/** What a C-arm is taken for where its source does not state it: a detector of 0.3 m, or pixels of 0.3 mm. */
export const startLengths = ({ image_size_px: size }: Lengths): Record<Length, number> => ({ source_isocentre_mm: 700, pixel_mm: Math.max(0.3, Math.round(3000 / Math.min(...(size ?? [1000]))) / 10) });

const FILLED = 0.45, CLEAR = 20; // part of a detector's width that is used, from its middle; mm between structure and detector

const number = (value: number) => String(Number(value.toPrecision(6)));
const text = (words: string) => (/^[A-Za-z]+[0-9]+$/.test(words) && !/^e[0-9]/i.test(words) ? words : JSON.stringify(words));
const list = (values: number[]) => `[${values.map(number).join(", ")}]`;
const rounded = (value: number) => Math.floor(10 * value + 0.5) / 10; // halves upwards, as the service rounds

export function firstDesign(points: Point[], file: string, { arm, limit_mm, stated }: Wishes): string {
  const ends = [0, 1, 2].map((k) => [Math.min(...points.map((p) => p.position_mm[k])), Math.max(...points.map((p) => p.position_mm[k]))]);
  const size = Math.max(20, Math.ceil(Math.max(...ends.map(([low, high]) => high - low)))), half = size / 2;
  const middle = ends.map(([low, high]) => rounded((low + high) / 2)), place = (...offset: number[]) => list(middle.map((value, k) => Number((value + offset[k]).toFixed(6))));

  // Where the beams' axes pass, and how far from the source that has to be for beads and target to be seen
  const start = startLengths(arm), detector = arm.source_detector_mm, pixel = arm.pixel_mm ?? start.pixel_mm, filled = FILLED * pixel * Math.min(...(arm.image_size_px ?? [1000]));
  const target = Math.max(half + 10, Math.min(half + 50, Math.trunc((2 * filled * (detector - size - CLEAR)) / detector - half)));
  const isocentre = rounded((target - half) / 2), reach = Math.max(half, target - isocentre, isocentre + half);
  const farthest = Math.min(Math.ceil(half + (reach * detector) / filled), Math.trunc(detector - half - CLEAR));
  const missing = (["source_isocentre_mm", "pixel_mm"] as Length[]).filter((field) => arm[field] == null);
  const lengths = new Map<string, [number, string]>(missing.map((field) => [field, [start[field], "not published for this C-arm: measure yours"]]));
  if (farthest > (arm.source_isocentre_mm ?? start.source_isocentre_mm)) lengths.set("source_isocentre_mm", [farthest, "nearer to the detector than the isocentre, so that all is seen"]);
  const own = !arm.name, given = own ? (["source_detector_mm", "source_isocentre_mm", "pixel_mm"] as const).filter((field) => !lengths.has(field)) : [];
  const guesses = [
    "isocentre_mm", ...(own || stated.has("arm") ? [] : ["preset"]), ...lengths.keys(), ...[...given, ...(own ? ["image_size_px"] : [])].filter((field) => !stated.has(field)), "fiducial_noise_px", "target_noise_px",
  ];
  const view = (side: string) => `\
  - name: ${side}
${own ? "" : `    preset: ${arm.name}${arm.title ? ` # ${arm.title}` : ""}\n`}\
${given.map((field) => `    ${field}: ${number(arm[field]!)}\n`).join("")}\
${own ? `    image_size_px: ${list(arm.image_size_px!)}\n` : ""}\
${[...lengths].map(([field, [value, why]]) => `    ${field}: ${value} # ${why}\n`).join("")}\
    orientation: ${side}
    isocentre_mm: ${place(0, 0, isocentre)} # the middle of beads and target
    fiducial_noise_px: 0.3 # how well one is located; measure yours
    target_noise_px: 0.3
`;
  const seat = (interface_: string, label: string, down: number) => `\
  ${interface_}:
    label: ${label}
    pivot_mm: ${place(0, 0, -(half + down))}
    tolerances:
${["rx", "ry", "rz"].map((axis) => `      ${axis}: { half_width_deg: 0.1, distribution: uniform }\n`).join("")}\
${["tx", "ty", "tz"].map((axis) => `      ${axis}: { half_width_mm: 0.05, distribution: uniform }\n`).join("")}`;
  return `\
# A first design about the fiducials of ${file.replace(/\s+/g, " ")}.  The list \`assumed\` at its end says which values
# nobody stated.
#
# Frame con (connector): that of the file; z is taken to point to the patient.  Lengths in mm.
schema: tailstack/design/1
name: ${JSON.stringify(`first design of ${file}`.slice(0, 80))}

views: # two shots; add more, or give calibrated projections
${view("AP")}${view("LAT")}
fiducials:
  points: # metal beads in the carrier
${points.map((point) => `    - { label: ${text(point.label)}, position_mm: ${list(point.position_mm)} }\n`).join("")}\
  manufacturing: { half_width_mm: 0.05, distribution: uniform } # where a bead truly sits

interfaces: # half-widths of what may differ from one assembly to the next, about the pivot
  # instead of tolerances: what a drawing states, flatness and fits, as in tailstack example dowelled_seat
${seat("structure_connector", "carrier on connector", 15)}${seat("connector_flange", "connector on the robot's flange", 65)}
targets:
  - { name: tip, position_mm: ${place(0, 0, target)} } # where the error counts

requirements:
  - { name: tip-accuracy, error: tcp, quantile: 0.95, limit_mm: ${number(limit_mm)} }

optimise: # what an optimisation may change
  box: { min_mm: ${place(-half, -half, -half)}, max_mm: ${place(half, half, half)} } # where the beads may go
  min_spacing_mm: ${number(rounded((0.4 * size) / points.length ** (1 / 3)))}
  rotation_bounds: { min_deg: 0.01, max_deg: 0.5 } # how tight and how loose the seats may be made
  starts: 8

assumed: # what nobody stated: a change on the page takes a value off
${[...[0, 1].flatMap((k) => guesses.map((field) => `/views/${k}/${field}`)), "/fiducials/manufacturing", "/interfaces/structure_connector", "/interfaces/connector_flange", "/targets/0/position_mm", ...(stated.has("limit_mm") ? [] : ["/requirements/0/limit_mm"])].map((pointer) => `  - ${pointer}\n`).join("")}`;
}
