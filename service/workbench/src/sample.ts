// Many designs at once: which numbers vary between which bounds, a low-discrepancy sequence of them, what each costs,
// which of them keep to what was brushed, and a picture of all their lines.  Scores are the service's.

import { type Json, type Path, pointerOf, SEATS, valueAt } from "./document";

/** A number that may vary, at one place of the design or at several. */
export interface Axis {
  key: string;
  label: string;
  unit: string;
  now: number;
  low: number; // between which it is drawn, unless somebody says otherwise
  high: number;
  log: boolean;
  choices: number[]; // of process grades; empty: anything between the bounds
  paths: Path[];
  place(value: number): number[]; // what stands at each of the paths
  read(data: Json): number | null; // of a design; null where what stands there is of no value
}
export interface HalfWidth {
  path: Path;
  label: string;
  unit: string;
}

// --- what may vary -----------------------------------------------------------------------------------------------------

const REACH_MM = 20, SCALED: [number, number] = [0.5, 2], MOST_TARGETS = 12, JOINED = ["fiducial_noise_px", "target_noise_px"];
const digits3 = (value: number) => Number(value.toPrecision(3));

/** Everything of a design that an axis can be of; ``halfWidths``: those of the list of contributors. */
export function axesOf(data: Json, halfWidths: readonly HalfWidth[]): Axis[] {
  const free = new Map(freeOf(data).map((each) => [pointerOf(each.path), each])), views: Json[] = Array.isArray(data?.views) ? data.views : [];
  const made = (key: string, label: string, unit: string, paths: Path[], log = true, place = (value: number) => paths.map(() => value)): Axis => {
    const now: number = valueAt(data, paths[0]), own = free.get(key), [low, high] = own ? [own.low, own.high] : log ? (now > 0 ? SCALED.map((part) => digits3(part * now)) : [0.01, 0.1]) : [now - REACH_MM, now + REACH_MM];
    return { key, label, unit, now, low, high, log, choices: own?.choices ?? [], paths, place, read: (other) => { const all = paths.map((path) => valueAt(other, path)); return all.every((value) => typeof value === "number" && value === all[0]) ? all[0] : null; } };
  };
  const joined = JOINED.filter((field) => views.length > 1 && views.every((view) => typeof view?.[field] === "number" && view[field] === views[0][field]));
  const alone = halfWidths.filter(({ path }) => !(path[0] === "views" && joined.includes(String(path[2]))));
  const points: Json[] = Array.isArray(data?.fiducials?.points) ? data.fiducials.points : [], targets: Json[] = Array.isArray(data?.targets) ? data.targets.slice(0, MOST_TARGETS) : [];
  return [
    ...alone.map(({ path, label, unit }) => made(pointerOf(path), label, unit, [path])),
    ...joined.map((field) => made(`/views/*/${field}`, `${field.replace(/_px$/, "").replace(/_/g, " ")}, every view`, "px", views.map((_, k) => ["views", k, field]))),
    ...(typeof data?.fiducials?.diameter_mm === "number" ? [made("/fiducials/diameter_mm", "diameter of the beads", "mm", [["fiducials", "diameter_mm"]])] : []),
    ...sizeOf(points),
    ...targets.flatMap((target, k) => [0, 1, 2].filter((axis) => typeof target?.position_mm?.[axis] === "number").map((axis) => made(`/targets/${k}/position_mm/${axis}`, `${target.name ?? `target ${k + 1}`}, ${"xyz"[axis]}`, "mm", [["targets", k, "position_mm", axis]], false))),
  ];
}

const ROUNDED_MM = 3e-3; // that coordinates of a layout of another size may be off by, each of them rounded to 0.001

/** How large the layout of the beads is: they move away from their middle, all by the same factor. */
function sizeOf(points: Json[]): Axis[] {
  const at: number[][] = points.map((point) => point?.position_mm), sound = (all: Json[]) => all.every((p) => Array.isArray(p) && p.length === 3 && p.every((v) => typeof v === "number"));
  if (at.length < 2 || !sound(at)) return [];
  const largest = (all: number[][]) => Math.max(...all.flatMap((p, k) => all.slice(k + 1).map((q) => Math.hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2])))), now = largest(at), middle = [0, 1, 2].map((k) => at.reduce((sum, p) => sum + p[k], 0) / at.length);
  const place = (value: number) => at.flatMap((p) => p.map((v, k) => (value === now ? v : Number((middle[k] + ((v - middle[k]) * value) / now).toFixed(3)))));
  const read = (data: Json) => {
    const other: Json[] = (Array.isArray(data?.fiducials?.points) ? data.fiducials.points : []).map((point: Json) => point?.position_mm), size = other.length === at.length && sound(other) ? largest(other) : 0, flat = other.flat();
    return size > 0 && place(size).every((v, k) => Math.abs(v - flat[k]) <= ROUNDED_MM) ? size : null;
  };
  return now > 0 ? [{ key: "size", label: "size of the bead layout", unit: "mm", now, low: digits3(0.6 * now), high: digits3(1.4 * now), log: true, choices: [], paths: at.flatMap((_, k) => [0, 1, 2].map((axis) => ["fiducials", "points", k, "position_mm", axis])), place, read }] : [];
}

// --- what it costs -----------------------------------------------------------------------------------------------------

interface Free {
  path: Path;
  low: number;
  high: number;
  choices: number[];
  price(halfWidth: number): number;
}
const NATIVE: Record<string, number> = { deg: Math.PI / 180, mm: 1 }, COMPONENTS: Record<string, string[]> = { deg: ["rx", "ry", "rz"], mm: ["tx", "ty", "tz"] };

/** Half-widths that the design frees for its optimisation, with bounds and prices as it states them. */
function freeOf(data: Json): Free[] {
  const section = data?.optimise, listed: Json[] = Array.isArray(section?.tolerances) ? section.tolerances : [];
  const freed = (name: string, component: string, unit: string, stated: Json): Free[] => {
    const field = `half_width_${unit}`, locators: Json[] = data?.interfaces?.[name]?.locators, k = Array.isArray(locators) ? locators.findIndex((each) => each?.name === component) : -1;
    const path: Path = k < 0 ? ["interfaces", name, "tolerances", component, field] : ["interfaces", name, "locators", k, field], grades: Json[] | undefined = Array.isArray(stated.grades) ? stated.grades : undefined;
    if (typeof valueAt(data, path) !== "number") return [];
    const choices = (grades ?? []).map((grade) => grade?.[field]).filter((width) => typeof width === "number").sort((a, b) => a - b), [low, high] = grades ? [choices[0], choices[choices.length - 1]] : [stated[`min_${unit}`], stated[`max_${unit}`]];
    const price = grades ? (h: number) => Math.min(Infinity, ...grades.filter((grade) => grade?.[field] <= h * (1 + 1e-9)).map((grade) => grade.price)) : curveOf(stated, unit);
    return typeof low === "number" && typeof high === "number" ? [{ path, low, high, choices, price }] : [];
  };
  const common = SEATS.flatMap((name) => {
    const { correlation, ...declared } = data?.interfaces?.[name]?.tolerances ?? {}, together: Json[] = Array.isArray(correlation) ? correlation.flatMap((pair) => (pair?.coefficient ? pair.between ?? [] : [])) : [];
    return Object.entries({ deg: section?.rotation_bounds, mm: section?.translation_bounds }).flatMap(([unit, bounds]) => bounds ? COMPONENTS[unit].filter((c) => declared[c] && !together.includes(c) && !listed.some((each) => each?.interface === name && each.component === c)).flatMap((c) => freed(name, c, unit, bounds)) : []);
  });
  return [...common, ...listed.flatMap((each) => (each ? freed(each.interface, each.component, COMPONENTS.deg.includes(each.component) ? "deg" : "mm", each) : []))];
}

function curveOf({ cost, cost_weight: plain = 1 }: Json, unit: string): (halfWidth: number) => number {
  const { curve = "reciprocal", weight = 1, [`scale_${unit}`]: scale } = cost ?? { weight: plain }, native = NATIVE[unit];
  return curve === "exponential" ? (h) => weight * Math.exp(-h / scale) : (h) => weight / (h * native) ** (curve === "reciprocal" ? 1 : 2);
}

/** What a design costs by its curves and grades, as an optimisation counts it, with other half-widths by pointer; null
 * where it states none. */
export function costOf(data: Json): ((other: ReadonlyMap<string, number>) => number) | null {
  const free = freeOf(data).map(({ path, price }) => ({ at: pointerOf(path), now: valueAt(data, path) as number, price })), each: number = data?.optimise?.count?.cost_per_fiducial ?? 0, count = data?.fiducials?.points?.length ?? 0;
  return free.length ? (other) => free.reduce((sum, { at, now, price }) => sum + price(other.get(at) ?? now), each * count) : null;
}

// --- a low-discrepancy sequence ----------------------------------------------------------------------------------------

// Sobol: the degree of a primitive polynomial, its inner coefficients, first directions (Joe and Kuo, new-joe-kuo-6.21201)
const PRIMITIVE: [number, number, number[]][] = [
  [1, 0, [1]], [2, 1, [1, 3]], [3, 1, [1, 3, 1]], [3, 2, [1, 1, 1]], [4, 1, [1, 1, 3, 3]], [4, 4, [1, 3, 5, 13]], [5, 2, [1, 1, 5, 5, 17]], [5, 4, [1, 1, 5, 5, 5]],
  [5, 7, [1, 1, 7, 11, 19]], [5, 11, [1, 1, 5, 1, 1]], [5, 13, [1, 1, 1, 3, 11]], [5, 14, [1, 3, 5, 5, 31]], [6, 1, [1, 3, 3, 9, 7, 49]], [6, 13, [1, 1, 1, 15, 21, 21]], [6, 16, [1, 3, 1, 13, 27, 49]],
];
export const MOST_AXES = PRIMITIVE.length + 1;

function directionsOf(dimension: number): number[] {
  if (!dimension) return Array.from({ length: 32 }, (_, k) => (1 << (31 - k)) >>> 0);
  const [degree, inner, first] = PRIMITIVE[dimension - 1], all = first.map((m, k) => (m << (31 - k)) >>> 0);
  for (let k = degree; k < 32; k += 1) {
    let next = all[k - degree] ^ (all[k - degree] >>> degree);
    for (let j = 1; j < degree; j += 1) if ((inner >> (degree - 1 - j)) & 1) next ^= all[k - j];
    all.push(next >>> 0);
  }
  return all;
}

/** Another number for each of two (Mulberry32's last steps). */
function mixed(seed: number, dimension: number): number {
  let x = (seed + Math.imul(dimension + 1, 0x6d2b79f5)) | 0;
  x = Math.imul(x ^ (x >>> 15), x | 1);
  x ^= x + Math.imul(x ^ (x >>> 7), x | 61);
  return (x ^ (x >>> 14)) >>> 0;
}

/** Points of Sobol's sequence, a column for each dimension, in (0, 1); a seed other than 0 shifts their digits. */
export function sobol(count: number, dimensions: number, seed: number): Float64Array[] {
  return Array.from({ length: dimensions }, (_, dimension) => {
    const directions = directionsOf(dimension), column = new Float64Array(count), shift = seed ? mixed(seed, dimension) : 0;
    for (let k = 0, x = 0; k < count; k += 1) {
      column[k] = (((x ^ shift) >>> 0) + 0.5) / 2 ** 32;
      x ^= directions[31 - Math.clz32(~k & (k + 1))];
    }
    return column;
  });
}

/** The value of an axis at a place between its bounds, as it is written into a design: three digits, within the bounds. */
export function valueOf({ choices, log, low, high }: Axis, at: number): number {
  const allowed = choices.filter((each) => each >= low && each <= high);
  if (allowed.length) return allowed[Math.min(allowed.length - 1, Math.floor(at * allowed.length))];
  const value = log ? low * (high / low) ** at : low + at * (high - low), worth = log ? digits3(value) : Number(value.toFixed(Math.max(0, 3 - Math.ceil(Math.log10(high - low)))));
  return Math.min(high, Math.max(low, worth));
}

// --- what is kept ------------------------------------------------------------------------------------------------------

export type Range = readonly [number, number]; // ends may be infinite

/** Which rows lie in every range; one that has no number in a column is in none. */
export function keptBy(columns: readonly Float64Array[], ranges: readonly (Range | undefined)[]): Uint8Array {
  const kept = new Uint8Array(columns[0]?.length ?? 0).fill(1);
  columns.forEach((column, c) => {
    const [low, high] = ranges[c] ?? [-Infinity, Infinity];
    for (let k = 0; k < kept.length; k += 1) if (!(column[k] >= low && column[k] <= high)) kept[k] = 0;
  });
  return kept;
}

/** A column of CSV for each name; texts that hold a comma are in quotes. */
export function csvOf(names: readonly string[], columns: readonly Float64Array[], rows: readonly number[]): string {
  const header = names.map((name) => (/[",\n]/.test(name) ? `"${name.replace(/"/g, '""')}"` : name)).join(",");
  return [header, ...rows.map((row) => columns.map((column) => column[row]).join(","))].join("\r\n") + "\r\n";
}

// --- the picture of all lines ------------------------------------------------------------------------------------------

/** How many lines cross each pixel of a picture of parallel axes, of all rows and of those that are kept: what a brush
 * changes is added and taken away, so that it costs as much as it changes. */
export class Crossings {
  readonly all: Uint16Array;
  readonly kept: Uint16Array; // column by column of the picture
  private readonly drawn: Uint8Array;
  private readonly showing: Uint8Array;

  /** ``xs``: columns of the axes; ``lines``: for each axis the pixel of each row, from the top, -1 where it has no number. */
  constructor(readonly xs: readonly number[], readonly height: number, private readonly lines: readonly Int16Array[]) {
    const size = (xs[xs.length - 1] + 1) * height, rows = lines[0].length;
    [this.all, this.kept, this.drawn, this.showing] = [new Uint16Array(size), new Uint16Array(size), new Uint8Array(rows), new Uint8Array(rows)];
    for (let row = 0; row < rows; row += 1) if (lines.every((line) => line[row] >= 0)) {
      this.draw(this.all, row, 1);
      this.drawn[row] = 1;
    }
  }

  show(kept: Uint8Array): void {
    let changed = 0, count = 0, total = 0;
    for (let row = 0; row < kept.length; row += 1) {
      const wanted = kept[row] & this.drawn[row];
      changed += wanted ^ this.showing[row];
      count += wanted;
      total += this.drawn[row];
    }
    if (count < changed && count <= total - count) {
      this.kept.fill(0);
      this.showing.fill(0);
    } else if (total - count < changed) {
      this.kept.set(this.all);
      this.showing.set(this.drawn);
    }
    for (let row = 0; row < kept.length; row += 1) {
      const wanted = kept[row] & this.drawn[row];
      if (wanted !== this.showing[row]) this.draw(this.kept, row, wanted ? 1 : -1);
      this.showing[row] = wanted;
    }
  }

  private draw(counts: Uint16Array, row: number, by: number): void {
    const { xs, height, lines } = this;
    for (let g = 0; g + 1 < xs.length; g += 1) {
      const from = xs[g], to = xs[g + 1], step = (lines[g + 1][row] - lines[g][row]) / (to - from);
      let y = lines[g][row] + 0.5;
      for (let x = from; x < to; x += 1) {
        const a = y | 0, b = (y += step) | 0, base = x * height;
        if (a === b) counts[base + a] += by;
        else if (a < b) for (let j = a; j < b; j += 1) counts[base + j] += by;
        else for (let j = a; j > b; j -= 1) counts[base + j] += by;
      }
    }
  }

  /** Both as the colours of an image: what is kept over the rest, the more lines the denser. */
  paint(pixels: Uint8ClampedArray, width: number, colours: { all: readonly number[]; kept: readonly number[] }): void {
    const shades = (counts: Uint16Array, least: number) => {
      let most = 1;
      for (let k = 0; k < counts.length; k += 1) if (counts[k] > most) most = counts[k];
      return Uint8Array.from({ length: most + 1 }, (_, count) => 255 * (least + ((1 - least) * Math.log(count || 1)) / Math.log(most + 1)));
    };
    const behind = shades(this.all, 0.1), front = shades(this.kept, 0.35);
    for (let x = 0, k = 0; x < width; x += 1) for (let y = 0; y < this.height; y += 1, k += 1) {
      const own = this.kept[k], colour = own ? colours.kept : colours.all, at = 4 * (y * width + x);
      pixels[at] = colour[0];
      pixels[at + 1] = colour[1];
      pixels[at + 2] = colour[2];
      pixels[at + 3] = own ? front[own] : this.all[k] ? 0.5 * behind[this.all[k]] : 0;
    }
  }
}
