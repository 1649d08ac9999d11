// What to do next, and what it would come to: which half-width by itself brings the design within its limit, and what an
// optimisation may change where the design does not say.

import { effect, signal } from "@preact/signals";
import { answer, current, pointerOf, refused, type Score, send } from "./api";
import { design, gesture, type Json, type Path, valueAt } from "./state";
import { decisive, verified } from "./verdicts";
import { brief } from "./words";

export interface Advice {
  design: Json; // of which it is
  paths: Path[];
  value: number;
  words: string; // "connector on flange rx, ry to 0.12°"
  found: number; // mm, that the requirement which decides comes to
  passes: boolean;
}
export const advice = signal<Advice | null>(null);

const MOST_TARGETS = 40; // beyond, a look takes the service long
const QUIET = 400; // ms without a change, after which it is looked for
effect(() => {
  const score = answer.value?.score, asked = design.value;
  if (!score || score.targets.length > MOST_TARGETS || !current.value || refused.value || gesture.value.length || advice.peek()?.design === asked) return;
  if ((verified.value?.verdict ?? score.verdict).status !== "fail") return;
  const timer = window.setTimeout(() => void look(asked, score), QUIET);
  return () => window.clearTimeout(timer);
});

interface Candidate {
  paths: Path[]; // of one half-width, or of those of one seat that are alike
  words: string;
  unit: string;
  now: number;
  part: number; // of its variance that may stay
}

export type Line = Score["targets"][number]["contributors"][number];

/** Where the half-width of a line of the budget, or the deviation of a noise, stands in the design. */
export function placeOf(data: Json, { name, component, half_width: width, unit }: Line): Path | null {
  const field = `half_width_${unit}`, seat: Path = name === "hand_eye" ? ["execution", "hand_eye"] : ["interfaces", name];
  const locators: Json[] = valueAt(data, [...seat, "locators"]) ?? [], k = Array.isArray(locators) ? locators.findIndex((each) => each?.name === component) : -1;
  const [what, view] = name.split(/:(.*)/s), views: Json[] = Array.isArray(data?.views) ? data.views : [], seen = views.findIndex((each) => each?.name === view);
  const places: Path[] = [
    [...seat, "tolerances", component, field], ...(k >= 0 ? [[...seat, "locators", k, field]] : []), ...(name === "fiducial_manufacturing" ? [["fiducials", "manufacturing", field]] : []),
    ...(name === "temperature" ? [["temperature", "half_width_k"]] : []), ...(/_noise$/.test(what) && seen >= 0 ? [["views", seen, `${what}_px`]] : []),
  ];
  return places.find((path) => typeof valueAt(data, path) === "number" && Math.abs(valueAt(data, path) - (width ?? 0)) < 1e-9) ?? null;
}

const down = (value: number) => {
  const unit = 10 ** (Math.floor(Math.log10(value)) - 1);
  return Number((Math.floor(value / unit + 1e-9) * unit).toPrecision(2));
};

/** Half-widths that may be tightened, the one first that has to be changed least: one by itself, or those of one seat
 * that are alike.  What is left of the variance is reckoned here; what it comes to, the service says. */
function candidates(data: Json, score: Score): Candidate[] {
  const worst = decisive(score.verdict.checks), target = score.targets.find(({ name }) => name === worst?.target);
  if (!worst || !target) return [];
  const goal = (worst.limit_mm / worst.value_mm) ** 2, groups = new Map<string, { path: Path; component: string; share: number; words: string; unit: string; now: number }[]>();
  for (const c of target.contributors) {
    const path = c.half_width && c.unit !== "px" && c.variance_share > 0.01 ? placeOf(data, c) : null;
    if (!path) continue;
    const line = { path, component: c.component === "all" ? "" : c.component, share: c.variance_share, words: (c.label || c.name).split(",")[0].slice(0, 60), unit: c.unit, now: c.half_width! }, group = JSON.stringify([c.name, c.unit, c.half_width]);
    groups.set(group, [...(groups.get(group) ?? []), line]);
  }
  const made = (lines: { path: Path; component: string; share: number; words: string; unit: string; now: number }[]): Candidate => {
    const share = lines.reduce((sum, line) => sum + line.share, 0), [{ words, unit, now }] = lines;
    return { paths: lines.map(({ path }) => path), words: `${words} ${lines.map(({ component }) => component).join(", ")}`.trim(), unit: unit === "deg" ? "°" : ` ${unit}`, now, part: 1 - (1 - goal) / share };
  };
  const all = [...groups.values()].flatMap((lines) => {
    const ranked = [...lines].sort((a, b) => b.share - a.share);
    return ranked.length > 1 ? [made(ranked.slice(0, 1)), made(ranked)] : [made(ranked)];
  });
  const modest = (each: Candidate) => Number(each.paths.length === 1 && each.part > 0.25); // one by itself, by less than half
  const enough = all.filter(({ part }) => part > 0.02).sort((a, b) => modest(b) - modest(a) || b.part - a.part).slice(0, 3);
  return enough.length ? enough : all.sort((a, b) => b.part - a.part).slice(0, 2).map((each) => ({ ...each, part: 0.25 })); // none is: what half of it does
}

async function look(asked: Json, score: Score): Promise<void> {
  const all = candidates(asked, score), rows = all.flatMap((each) => [1, 0.96, 0.92, 0.84].map((part) => ({ each, value: down(each.now * Math.sqrt(each.part) * part) }))).filter(({ value }) => value > 0);
  if (!rows.length) return;
  const columnsOf = all.flatMap((column) => column.paths.map((path) => [pointerOf(path), column] as const));
  const table: Record<string, number[]> = {};
  for (const [pointer, column] of columnsOf) table[pointer] = rows.map(({ each, value }, k) => (each.paths.some((path) => pointerOf(path) === pointer) ? value : table[pointer]?.[k] ?? column.now));
  const response = await send("POST", "/v1/scores/batch", { design: asked, table, columns: ["value_mm", "verdict"] }).catch(() => null);
  if (!response?.ok || design.value !== asked) return;
  const { columns } = (await response.json()) as { columns: Record<string, Json[]> }, worst = decisive(score.verdict.checks)!;
  const found = columns[`value_mm:${worst.requirement}:${worst.target}`] ?? columns[Object.keys(columns).find((name) => name.startsWith("value_mm:"))!];
  const results = rows.map((row, k) => ({ ...row, found: found[k] as number | null, passes: columns.verdict[k] === "pass" })).filter((row) => row.found !== null);
  const best = results.find(({ passes }) => passes) ?? results.sort((a, b) => a.found! - b.found!)[0];
  if (best) advice.value = { design: asked, paths: best.each.paths, value: best.value, words: `${best.each.words} to ${brief(best.value)}${best.each.unit}`, found: best.found!, passes: best.passes };
}

// --- what may change ---------------------------------------------------------------------------------------------------

export const START = "from: a box round the beads, seats ± 50 %";

/** What an optimisation may change where the design does not say: beads in a box round where they are, half-widths of
 * the seats by half of themselves; spacing in space and in the images is kept as it is, where it is close. */
export function startOf(data: Json, score: Score | null): Json {
  const points: number[][] = (Array.isArray(data?.fiducials?.points) ? data.fiducials.points : []).map((p: Json) => p?.position_mm).filter((p: Json) => Array.isArray(p) && p.length === 3);
  const ends = [0, 1, 2].map((k) => [Math.floor(Math.min(...points.map((p) => p[k]))), Math.ceil(Math.max(...points.map((p) => p[k])))]).map(([low, high]) => (high > low ? [low, high] : [low - 1, high + 1]));
  const apart = Math.min(...points.flatMap((a, k) => points.slice(k + 1).map((b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]))));
  const least = (usual: number, values: (number | null | undefined)[]) => Math.max(0, Math.min(usual, ...values.filter((v): v is number => typeof v === "number").map(Math.floor)));
  const views = score?.views ?? [];
  const tolerances = ["structure_connector", "connector_flange"].flatMap((interface_) => {
    const seat = data?.interfaces?.[interface_] ?? {}, named: [string, Json][] = [...Object.entries(seat.tolerances ?? {}), ...(Array.isArray(seat.locators) ? seat.locators.map((each: Json) => [each?.name, each] as [string, Json]) : [])];
    return named.flatMap(([component, given]) => ["deg", "mm"].flatMap((unit) => {
      const width = given?.[`half_width_${unit}`];
      return typeof width === "number" && width > 0 && given.distribution !== "bounded" ? [{ interface: interface_, component, [`min_${unit}`]: Number((width / 2).toPrecision(3)), [`max_${unit}`]: Number((1.5 * width).toPrecision(3)) }] : [];
    }));
  });
  return {
    ...(points.length ? { box: { min_mm: ends.map(([low]) => low), max_mm: ends.map(([, high]) => high) } } : {}),
    min_spacing_mm: Number.isFinite(apart) ? least(10, [apart]) : 10,
    min_projected_spacing_px: least(25, views.map((view) => view.closest_pair_px)), image_margin_px: least(20, views.map((view) => view.smallest_margin_px)),
    ...(tolerances.length ? { tolerances } : {}),
    starts: 4,
  };
}
