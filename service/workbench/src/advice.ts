// What to do next, and what it would come to: which half-width by itself brings the design within its limit, what each
// lever reaches at best, and what an optimisation may change where the design does not say.  All of it is of the estimate,
// and is looked for only where that holds.

import { computed, effect, signal } from "@preact/signals";
import { askWhenQuiet, current, pathOf, refused, type Score, send } from "./api";
import { SEATS } from "./document";
import { design, type Edit, gesture, type Json, type Path, pointerOf, valueAt, withEdits } from "./state";
import { answering, known, type Known, read, shown, standing, standingOf } from "./readings";
import { brief, decimalsOf } from "./words";

/** What one step comes to, by estimate. */
export interface Step {
  edits: Edit[];
  words: string; // "connector on flange rx, ry to 0.12°"
  found: number; // that the requirement which decides comes to, in its unit
  passes: boolean;
}
export interface Advice {
  design: Json; // of which it is
  shots: number; // of the simulation that it was made by, 0 where there was none
  step: Step | null;
  wall: string; // why there is no step that leads within the limit; empty where there is one
  unit: string; // of these numbers
  digits: number;
}
const advice = signal<Advice | null>(null);
const shots = ({ simulation }: Known) => simulation?.record.trials ?? 0;
/** Of the design on the page, by an estimate that holds. */
export const advised = computed(() => (advice.value && advice.value.design === design.value && advice.value.shots === shots(known.value) && standing.value.holds ? advice.value : null));

const MOST_TARGETS = 40; // beyond, a look takes the service long
const QUIET = 400; // ms without a change, after which it is looked for
effect(() => {
  const asked = design.value, { estimate } = known.value;
  if (!estimate || estimate.record.targets.length > MOST_TARGETS || !current.value || refused.value || gesture.value.length || (advice.peek()?.design === asked && advice.peek()?.shots === shots(known.value))) return;
  if (shown.value!.record.verdict.status !== "fail" || !standing.value.holds) return;
  return askWhenQuiet(QUIET, () => look(asked, known.peek()));
});

export type Line = Score["targets"][number]["contributors"][number];

/** Where the half-width of a line of the budget, or the deviation of a noise, stands in the design. */
export function placeOf(data: Json, { name, component, half_width: width, unit }: Pick<Line, "name" | "component" | "half_width" | "unit">): Path | null {
  const field = `half_width_${unit}`, seat: Path = name === "hand_eye" ? ["execution", "hand_eye"] : ["interfaces", name];
  const locators: Json[] = valueAt(data, [...seat, "locators"]) ?? [], k = Array.isArray(locators) ? locators.findIndex((each) => each?.name === component) : -1;
  const [what, view] = name.split(/:(.*)/s), views: Json[] = Array.isArray(data?.views) ? data.views : [], seen = views.findIndex((each) => each?.name === view);
  const places: Path[] = [
    [...seat, "tolerances", component, field], ...(k >= 0 ? [[...seat, "locators", k, field]] : []), ...(name === "fiducial_manufacturing" ? [["fiducials", "manufacturing", field]] : []),
    ...(name === "temperature" ? [["temperature", "half_width_k"]] : []), ...(/_noise$/.test(what) && seen >= 0 ? [["views", seen, `${what}_px`]] : []),
  ];
  return places.find((path) => typeof valueAt(data, path) === "number" && Math.abs(valueAt(data, path) - (width ?? 0)) < 1e-9) ?? null;
}

/** Half-widths of the process grades that the design lists for this very tolerance. */
export function gradesOf(data: Json, path: Path): number[] {
  const [, interface_, , part, name] = path, component = valueAt(data, path.slice(0, -1))?.name ?? part;
  const free: Json[] = Array.isArray(data?.optimise?.tolerances) ? data.optimise.tolerances : [];
  const own = free.find((tolerance) => tolerance?.interface === interface_ && tolerance?.component === component);
  return (own?.grades ?? []).map((grade: Json) => grade[name]).filter((width: unknown) => typeof width === "number" && width > 0);
}

/** Nobody is advised to make anything finer than a precision machinist does, 0.01 mm, and that over 57 mm; a hand-eye
 * calibration, which is measured, than the best that are published. */
const FINEST: Record<string, number> = { mm: 0.01, deg: 0.01, K: 0.1 }, MEASURED: Record<string, number> = { mm: 0.1, deg: 0.05 };

interface Width {
  path: Path;
  component: string;
  words: string; // of the seat
  unit: string;
  now: number;
  share: number;
  grades: number[];
}
/** Half-widths that may be tightened: one by itself, or those of one seat and unit, all to the same. */
interface Candidate {
  widths: Width[];
  needed: number; // 0 where none is enough
}

const down = (value: number) => {
  const unit = 10 ** (Math.floor(Math.log10(value)) - 1);
  return Number((Math.floor(value / unit + 1e-9) * unit).toPrecision(2));
};
const finestOf = ({ grades, unit, now, path }: Width) => Math.min(now, grades.length ? Math.min(...grades) : (path[1] === "hand_eye" ? MEASURED : FINEST)[unit] ?? now);

/** The largest half-width of all that leaves no more of the variance than ``goal``. */
function neededOf(widths: Width[], goal: number): number {
  const left = (value: number) => widths.reduce((sum, { share, now }) => sum + share * (1 - Math.min(1, value / now) ** 2), 0);
  let [low, high] = [0, Math.max(...widths.map(({ now }) => now))];
  if (left(0) < 1 - goal) return 0;
  for (let k = 0; k < 40; k += 1) [low, high] = left((low + high) / 2) >= 1 - goal ? [(low + high) / 2, high] : [low, (low + high) / 2];
  return low;
}

function widthsOf(data: Json, target: Score["targets"][number]): Width[] {
  return target.contributors.flatMap((c) => {
    const path = c.half_width && c.unit !== "px" && c.variance_share > 0 ? placeOf(data, c) : null;
    return path ? [{ path, component: c.component === "all" ? "" : c.component, words: (c.label || c.name).split(",")[0].slice(0, 60), unit: c.unit, now: c.half_width!, share: c.variance_share, grades: gradesOf(data, path) }] : [];
  });
}

/** What may be tightened, the one first that has to be changed least; what it comes to, the service says. */
function candidatesOf(widths: Width[], goal: number): Candidate[] {
  const groups = new Map<string, Width[]>();
  for (const width of widths.filter((width) => width.share > 0.01 && finestOf(width) < width.now)) {
    const group = JSON.stringify([width.path.slice(0, 2), width.unit]);
    groups.set(group, [...(groups.get(group) ?? []), width]);
  }
  const made = (some: Width[]): Candidate => ({ widths: some, needed: neededOf(some, goal) });
  const all = [...groups.values()].flatMap((some) => {
    const ranked = [...some].sort((a, b) => b.share - a.share);
    return ranked.length > 1 ? [made(ranked.slice(0, 1)), made(ranked)] : [made(ranked)];
  });
  const part = ({ widths: [{ now }], needed }: Candidate) => needed / now, modest = (each: Candidate) => Number(each.widths.length === 1 && part(each) > 0.5);
  return all.sort((a, b) => modest(b) - modest(a) || part(b) - part(a) || b.widths.reduce((sum, { share }) => sum + share, 0) - a.widths.reduce((sum, { share }) => sum + share, 0)).slice(0, 3);
}

/** Half-widths to try, the widest first: grades where there are some, else what is needed and less, down to the finest. */
function triesOf({ widths, needed }: Candidate): number[] {
  const most = Math.max(...widths.map(({ now }) => now)), finest = Math.max(...widths.map(finestOf)), grades = widths.flatMap((width) => width.grades);
  const begin = Math.max(needed || most / 2, finest), steps = [1, 0.96, 0.92, 0.84].map((part) => begin * part), between = [1, 2, 3].map((k) => begin * (finest / begin) ** (k / 4));
  const values = grades.length ? grades : [...steps, ...between].map(down).filter((value) => value > finest).concat(finest);
  return [...new Set(values)].filter((value) => value < most).sort((a, b) => b - a);
}

async function look(asked: Json, given: Known): Promise<void> {
  const { record, target: widest } = given.estimate!, worst = answering(given), { off } = standingOf(given);
  if (!worst) return;
  const { limit, unit } = worst, own = record.targets.find(({ name }) => name === worst.target), target = own ?? widest, digits = decimalsOf(record, unit);
  const aim = limit * (1 + (off ?? 0)), bias = Math.hypot(...target.bias_mm), give = (found: Omit<Advice, "design" | "shots" | "unit" | "digits">) => { if (design.value === asked) advice.value = { design: asked, shots: shots(given), unit, digits, ...found }; };
  if (own && unit === "mm" && bias > limit) return give({ step: null, wall: `The known bias of ${brief(bias)} mm is beyond the limit by itself: no tolerance and no place of a bead cures it, correct for it.` });
  const widths = widthsOf(asked, target), goal = (aim / worst.value) ** 2, place = ({ path }: Width) => pointerOf(path);
  const tried = candidatesOf(widths, goal).flatMap((each) => triesOf(each).map((value) => ({ each, value, set: new Map(each.widths.filter(({ now }) => now > value).map((width) => [place(width), value])) })));
  const finest = new Map(widths.map((width) => [place(width), finestOf(width)]));
  const rows = [...tried.map(({ set }) => set), finest], table: Record<string, number[]> = {};
  for (const pointer of new Set(rows.flatMap((row) => [...row.keys()]))) table[pointer] = rows.map((row) => row.get(pointer) ?? valueAt(asked, pathOf(pointer)));
  if (!Object.keys(table).length) return;
  const response = await send("POST", "/v1/scores/batch", { design: asked, table, columns: ["value", "verdict"] }).catch(() => null);
  if (!response?.ok) return;
  const { columns } = (await response.json()) as { columns: Record<string, Json[]> };
  const found: (number | null)[] = columns[`value:${worst.requirement}:${worst.target}`] ?? columns[Object.keys(columns).find((name) => name.startsWith("value:"))!];
  const passes = (k: number) => (off === null ? columns.verdict[k] === "pass" : found[k] !== null && found[k] <= aim), last = rows.length - 1;
  const stepOf = (k: number): Step => {
    const { each, value } = tried[k], changed = each.widths.filter(({ now }) => now > value), [{ words, unit }] = changed;
    return { edits: changed.map(({ path }) => ({ path, value })), words: `${words} ${changed.map(({ component }) => component).sort().join(", ")} to ${brief(value)}${unit === "deg" ? "°" : ` ${unit}`}`.replace("  ", " "), found: found[k]!, passes: passes(k) };
  };
  const known_ = tried.map((_, k) => k).filter((k) => found[k] !== null), good = known_.find(passes), best = [...known_].sort((a, b) => found[a]! - found[b]!)[0];
  const seats = found[last];
  if (good !== undefined) return give({ step: stepOf(good), wall: "" });
  if (best !== undefined && passes(last)) return give({ step: stepOf(best), wall: "" });
  give({ step: null, wall: seats === null ? "" : await wallOf(asked, finest, seats, unit) });
}

/** Why tightening does not lead within the limit: what is left where everything is at its finest. */
async function wallOf(asked: Json, finest: Map<string, number>, seats: number, of: string): Promise<string> {
  const tight = withEdits(asked, [...finest].map(([pointer, value]) => ({ path: pathOf(pointer), value })));
  const response = await send("POST", "/v1/scores", { design: tight }).catch(() => null);
  const target = response?.ok ? read<"estimate">((await response.json()) as Score).target : null, whole = target?.contributors.filter((c) => c.component === "all" || !target.contributors.some((other) => other.name === c.name && other.component === "all"));
  const first = [...(whole ?? [])].sort((a, b) => b.variance_share - a.variance_share)[0];
  return `No tightening keeps the limit: at best ${brief(Number(seats.toPrecision(3)))} ${of} by estimate, every half-width at its finest${first ? `, because ${(first.label || first.name).slice(0, 60)} has ${(100 * first.variance_share).toFixed(0)} % of what is left` : ""}.`;
}

// --- what may change ---------------------------------------------------------------------------------------------------

export const START = "from: a box round the beads, seats ± 50 %";

/** Each half-width of both seats, free from so many times what it is to so many. */
export const seatsOf = (data: Json, least: number, most: number): Json[] => SEATS.flatMap((interface_) => {
  const seat = data?.interfaces?.[interface_] ?? {}, named: [string, Json][] = [...Object.entries(seat.tolerances ?? {}), ...(Array.isArray(seat.locators) ? seat.locators.map((each: Json) => [each?.name, each] as [string, Json]) : [])];
  return named.flatMap(([component, given]) => ["deg", "mm"].flatMap((unit) => {
    const width = given?.[`half_width_${unit}`];
    return typeof width === "number" && width > 0 && given.distribution !== "bounded" ? [{ interface: interface_, component, [`min_${unit}`]: Number((least * width).toPrecision(3)), [`max_${unit}`]: Number((most * width).toPrecision(3)) }] : [];
  }));
});

/** What an optimisation may change where the design does not say: beads in a box round where they are, half-widths of
 * the seats by half of themselves; spacing in space and in the images is kept as it is, where it is close. */
export function startOf(data: Json, score: Score | null): Json {
  const points: number[][] = (Array.isArray(data?.fiducials?.points) ? data.fiducials.points : []).map((p: Json) => p?.position_mm).filter((p: Json) => Array.isArray(p) && p.length === 3);
  const ends = [0, 1, 2].map((k) => [Math.floor(Math.min(...points.map((p) => p[k]))), Math.ceil(Math.max(...points.map((p) => p[k])))]).map(([low, high]) => (high > low ? [low, high] : [low - 1, high + 1]));
  const apart = Math.min(...points.flatMap((a, k) => points.slice(k + 1).map((b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]))));
  const least = (usual: number, values: (number | null | undefined)[]) => Math.max(0, Math.min(usual, ...values.filter((v): v is number => typeof v === "number").map(Math.floor)));
  const views = score?.views ?? [];
  const tolerances = seatsOf(data, 0.5, 1.5);
  return {
    ...(points.length ? { box: { min_mm: ends.map(([low]) => low), max_mm: ends.map(([, high]) => high) } } : {}),
    min_spacing_mm: Number.isFinite(apart) ? least(10, [apart]) : 10,
    min_projected_spacing_px: least(25, views.map((view) => view.closest_pair_px)), image_margin_px: least(20, views.map((view) => view.smallest_margin_px)),
    ...(tolerances.length ? { tolerances } : {}),
    starts: 4,
  };
}
