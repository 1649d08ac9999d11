// The text of a first design about points that are there already, as first_design.py of the service writes it for the
// balls of a STEP file; here the C-arm and the limit are chosen.

import { signal } from "@preact/signals";
import type { components } from "../../../openapi/typescript/tailstack";
import { send } from "./api";

export type CArm = components["schemas"]["PresetEntry"];
export interface Point {
  label: string;
  position_mm: number[];
}

export const cArms = signal<CArm[]>([]);
export const cArm = signal("generic-mobile-c-arm");
export const limit = signal(1); // mm

export async function loadCArms(): Promise<void> {
  const response = await send("GET", "/v1/presets").catch(() => null);
  if (response?.ok) cArms.value = (await response.json()).presets;
}

const LENGTHS: Record<string, number> = { source_isocentre_mm: 700, pixel_mm: 0.3 }; // where the source of a C-arm states none

/** What is missing in what is published of a C-arm, and is assumed. */
export const assumed = (name: string): [string, number][] =>
  (cArms.value.find((each) => each.name === name)?.view_must_state ?? []).filter((field) => field in LENGTHS).map((field) => [field, LENGTHS[field]]);

const number = (value: number) => String(Number(value.toPrecision(6)));
const text = (words: string) => (/^[A-Za-z]+[0-9]+$/.test(words) && !/^e[0-9]/i.test(words) ? words : JSON.stringify(words));
const list = (values: number[]) => `[${values.map(number).join(", ")}]`;
const rounded = (value: number) => Number(value.toFixed(1));

export function firstDesign(points: Point[], file: string): string {
  const name = cArm.value, title = cArms.value.find((each) => each.name === name)?.title ?? "";
  const ends = [0, 1, 2].map((k) => [Math.min(...points.map((p) => p.position_mm[k])), Math.max(...points.map((p) => p.position_mm[k]))]);
  const size = Math.max(20, Math.ceil(Math.max(...ends.map(([low, high]) => high - low)))), half = size / 2;
  const centre = ends.map(([low, high]) => rounded((low + high) / 2)), place = (...offset: number[]) => list(centre.map((value, k) => Number((value + offset[k]).toFixed(6))));
  const target = half + 50, lengths = assumed(name);
  const view = (side: string) => `\
  - name: ${side}
    preset: ${name}${title ? ` # ${title}` : ""}
${lengths.map(([field, value]) => `    ${field}: ${value} # not published for this C-arm: measure yours\n`).join("")}\
    orientation: ${side}
    isocentre_mm: ${place(0, 0, rounded(target / 2))} # between the beads and the target
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
# A first design about the fiducials of ${file.replace(/\s+/g, " ")}.  Views, seats, tolerances, target and limit are a
# start and yours to correct.
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
${seat("structure_connector", "carrier on connector", 15)}${seat("connector_flange", "connector on the robot's flange", 65)}
targets:
  - { name: tip, position_mm: ${place(0, 0, target)} } # where the error counts

requirements:
  - { name: tip-accuracy, error: tcp, quantile: 0.95, limit_mm: ${number(limit.value)} }

optimise: # what an optimisation may change
  box: { min_mm: ${place(-half, -half, -half)}, max_mm: ${place(half, half, half)} } # where the beads may go
  min_spacing_mm: ${number(rounded((0.4 * size) / points.length ** (1 / 3)))}
  rotation_bounds: { min_deg: 0.01, max_deg: 0.5 } # how tight and how loose the seats may be made
  starts: 8
`;
}
