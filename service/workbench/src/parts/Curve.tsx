// What is limited over each half-width, under its slider, and where it keeps the limit: one request for all of them.  That
// place is dragged along the curve: the limit of what decides moves with the hand, and this half-width with it.

import { effect, signal, untracked } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { askWhenQuiet, current, pathOf, refused, send } from "../api";
import { answering, decimals, known, standing } from "../readings";
import type { HalfWidth } from "../sample";
import { cancelGesture, design, edit, gesture, type Json, type Path, pointerOf, PRESSES, preview, recall, remember, say, settled, valueAt } from "../state";
import { brief, mm } from "../words";
import { grip, stepsOf } from "./grip";
import { limitOf, passing, round, stepFor } from "./Limit";

type Range = [number, number];
type Values = (number | null)[];
interface Line {
  design: Json; // of which it is
  requirement: string;
  limit: number | null;
  share: number; // of the limit, that is kept with what the estimate may be off by
  step: number; // of the limit, that a hand can mean
  unit: string;
  at: number[]; // half-widths
  values: Values; // of what is limited, at the worst target; null where there is none
  crossing: number | null; // the half-width up to which the limit is kept
}

export const drawn = signal(recall("tailstack.workbench.curves", false));
effect(() => void remember("tailstack.workbench.curves", drawn.value));
const lines = signal<ReadonlyMap<string, Line>>(new Map()); // by pointer
const wanted = new Map<string, Range>(), asked = signal(0); // sliders in sight, and that there are others
const QUIET = 300, POINTS = 25, FINER = 17, MOST = 40;

const missing = (data: Json) => [...wanted].filter(([pointer]) => lines.value.get(pointer)?.design !== data);
effect(() => {
  const data = design.value;
  if (asked.value < 0 || !drawn.value || !current.value || refused.value || gesture.value.length || !standing.value.holds || !missing(data).length) return;
  return askWhenQuiet(QUIET, () => look(data));
});

// --- curves ------------------------------------------------------------------------------------------------------------

const between = (low: number, high: number, count: number) => Array.from({ length: count }, (_, k) => low * (high / low) ** (k / (count - 1)));

/** What is limited at each of these half-widths by itself; null where it is not to be had. */
async function valuesAt(data: Json, requirement: string, grids: ReadonlyMap<string, number[]>): Promise<Map<string, Values> | null> {
  const begin = requirement ? `value:${requirement}:` : "p95_mm", rows = [...grids].flatMap(([pointer, at]) => at.map((value) => ({ pointer, value })));
  const table = Object.fromEntries([...grids.keys()].map((pointer) => [pointer, rows.map((row) => (row.pointer === pointer ? row.value : valueAt(data, pathOf(pointer))))]));
  const response = await send("POST", "/v1/scores/batch", { design: data, table, columns: [requirement ? "value" : "p95_mm"] }).catch(() => null);
  if (!response?.ok) return null;
  const { columns } = (await response.json()) as { columns: Record<string, Values> }, own = Object.keys(columns).filter((name) => name.startsWith(begin));
  const worst = rows.map((_, k) => { const each = own.map((name) => columns[name][k]); return each.length && each.every((value) => value !== null) ? Math.max(...(each as number[])) : null; });
  let k = 0;
  return new Map([...grids].map(([pointer, at]) => [pointer, worst.slice(k, (k += at.length))]));
}

type Curved = Pick<Line, "at" | "values">;
/** Squares of what is limited go almost straight with squares of a half-width: between two points within 1 %. */
const along = (x: number, [a, b]: number[], [p, q]: number[]) => Math.sqrt(Math.max(0, p ** 2 + ((x ** 2 - a ** 2) / (b ** 2 - a ** 2)) * (q ** 2 - p ** 2)));
/** Between which points a curve comes up to a goal; -1 where it does not. */
const bracket = ({ at, values }: Curved, goal: number) => values.findIndex((value, j) => j + 1 < at.length && value !== null && values[j + 1] !== null && (value - goal) * (values[j + 1]! - goal) <= 0 && value !== values[j + 1]);
function widthAt({ at, values }: Curved, goal: number): number | null {
  const k = bracket({ at, values }, goal);
  return k < 0 ? null : along(goal, [values[k]!, values[k + 1]!], [at[k], at[k + 1]]);
}
function valueOf({ at, values }: Curved, width: number): number | null {
  const beyond = at.findIndex((each, j) => j > 0 && each >= width), k = (beyond < 0 ? at.length - 1 : beyond) - 1;
  return values[k] === null || values[k + 1] === null ? null : along(width, [at[k], at[k + 1]], [values[k]!, values[k + 1]!]);
}

/** The half-widths up to which goals are kept, by finer points between those of the curves. */
async function meet(data: Json, requirement: string, curves: ReadonlyMap<string, Curved>, goal: number): Promise<Map<string, number | null> | null> {
  const grids = new Map([...curves].flatMap(([pointer, line]) => { const k = bracket(line, goal); return k < 0 ? [] : [[pointer, between(line.at[k], line.at[k + 1], FINER)] as const]; }));
  const values = grids.size ? await valuesAt(data, requirement, grids) : new Map<string, Values>();
  return values && new Map([...curves.keys()].map((pointer) => [pointer, grids.has(pointer) ? widthAt({ at: grids.get(pointer)!, values: values.get(pointer)! }, goal) : null]));
}

async function look(data: Json): Promise<void> {
  const check = answering(known.value), limit = check?.limit ?? null, share = check ? passing(check) : 1, requirement = check?.requirement ?? "";
  if ((known.value.estimate?.record.targets.length ?? 0) > MOST) return;
  const grids = new Map(untracked(() => missing(data)).map(([pointer, range]) => [pointer, between(...range, POINTS)])), values = await valuesAt(data, requirement, grids);
  const curves = values && new Map([...grids].map(([pointer, at]) => [pointer, { at, values: values.get(pointer)! }])), met = curves && limit !== null ? await meet(data, requirement, curves, limit * share) : new Map<string, number>();
  if (!curves || !met || design.value !== data) return;
  const own = { design: data, requirement, limit, share, step: check ? stepFor(check) : 1, unit: check?.unit ?? "mm" };
  lines.value = new Map([...lines.value, ...[...curves].map(([pointer, curve]) => [pointer, { ...own, ...curve, crossing: met.get(pointer) ?? null }] as const)]);
}

/** With three digits that are within. */
function within(width: number): number {
  const worth = 10 ** (Math.floor(Math.log10(width)) - 2);
  return Number((Math.floor(width / worth) * worth).toPrecision(3));
}
/** The half-width up to which the limit is kept; null where it is not known of this design. */
export function crossingOf(pointer: string): number | null {
  const line = drawn.value ? lines.value.get(pointer) : undefined;
  return line?.design === settled.value && line?.crossing != null ? within(line.crossing) : null;
}

// --- the limit, dragged along one of them ------------------------------------------------------------------------------

const TOP = 1.5; // of the limit, as far as is drawn
interface Held {
  pointer: string;
  line: Line; // of the design at the grab
  path: Path; // of the limit
  at: number; // where the limit is
}
const held = signal<Held | null>(null);

function grab(pointer: string): boolean {
  if (held.value?.pointer === pointer) return true;
  const line = lines.value.get(pointer), path = line && limitOf(line.design, line.requirement);
  if (!path || line.limit === null || line.design !== settled.value || gesture.value.length || refused.value) return false;
  held.value = { pointer, line, path, at: line.limit };
  return true;
}

/** The limits that this half-width by itself can keep. */
function reach({ values, share, step, limit }: Line): Range {
  const all = values.filter((value) => value !== null);
  return [round(Math.min(...all) / share, step, Math.ceil), round(Math.min(Math.max(...all) / share, TOP * limit!), step, Math.floor)];
}

const editsOf = ({ pointer, path, at }: Held, width: number) => [{ path, value: at }, { path: pathOf(pointer), value: within(width) }];
/** The limit goes there, or as near as it can, and the half-width with it. */
function pull(to: number, step = 1): void {
  const now = held.value!, [least, most] = reach(now.line), at = Math.max(least, Math.min(most, round(to, now.line.step * step))), width = widthAt(now.line, at * now.line.share);
  if (width === null) return;
  held.value = { ...now, at };
  preview(editsOf(held.value, width));
}

function drop(): void {
  if (held.value) cancelGesture();
  held.value = null;
}

/** The half-width is found exactly, and both are one step. */
async function release(label: string, keys = false): Promise<void> {
  const now = held.value;
  if (!now) return;
  const { pointer, line, at } = now, met = await meet(line.design, line.requirement, new Map([[pointer, line]]), at * line.share), width = met?.get(pointer) ?? null;
  if (held.value?.line !== line || held.value.at !== at) return; // given up meanwhile, or moved on
  if (width === null) {
    drop();
    return say("The service does not answer: the limit stays where it was.", true);
  }
  held.value = null;
  edit(editsOf(now, width), keys ? `Limit of ${line.requirement} by keys, ${label} follows` : `Limit of ${line.requirement} to ${at} ${line.unit}, ${label} follows`, keys ? PRESSES : 0);
  lines.value = new Map([...lines.value, [pointer, { ...line, design: settled.value, limit: at, crossing: width }]]); // the curve is the same: it goes over what was changed
}
// Another text under the hand ends a drag: what it showed is of nothing that is there
effect(() => {
  const now = held.value;
  if (now && settled.value !== now.line.design) untracked(drop);
});

// --- drawn -------------------------------------------------------------------------------------------------------------

/** The curve on the slider's own scale; ``place``: from a half-width to its place there, 0 to 1. */
export function Curve({ slide: { path: own, label, unit }, range, place }: { slide: HalfWidth; range: Range; place(value: number): number }) {
  const track = useRef<HTMLSpanElement>(null), pointer = pointerOf(own);
  useEffect(() => {
    wanted.set(pointer, range);
    asked.value += 1;
    return () => void wanted.delete(pointer);
  }, [pointer]);
  const line = lines.value.get(pointer), now = held.value?.pointer === pointer ? held.value : null, fresh = line?.design === settled.value && (now !== null || gesture.value.every(({ path }) => pointerOf(path) === pointer));
  if (!drawn.value) return null;
  if (!line) return <span class="curve" />;
  const near = line.values.filter((value): value is number => value !== null), least = Math.min(...near), low = 0.97 * Math.min(least, line.limit ?? Infinity), top = TOP * (line.limit ?? least), y = (value: number) => 21 - (20 * Math.min(value - low, 2 * top)) / (top - low);
  const limit = now?.at ?? line.limit, met = now ? valueAt(design.value, own) as number : crossingOf(pointer);
  const drawing = line.at.reduce((path, at, k) => (line.values[k] === null ? path : `${path}${k && line.values[k - 1] !== null ? "L" : "M"}${(1000 * place(at)).toFixed(1)} ${y(line.values[k]!).toFixed(2)}`), "");
  const keeps = met === null ? "" : `${brief(limit)} ${line.unit} is kept up to ${brief(met)} ${unit}`.replace(" °", "°");
  const words = `${label}: ${mm(least, decimals.value)} ${line.unit} at best${limit === null ? "" : met === null ? ", the limit is not met by it alone" : `, ${keeps}`}`;
  const movable = limitOf(line.design, line.requirement) !== null, [lowest, highest] = line.limit === null ? [0, 0] : reach(line), take = () => void (fresh && met !== null && met !== valueAt(design.value, own) && edit([{ path: own, value: met }], `${label} to its limit`));
  return (
    <span ref={track} class={fresh ? "curve" : "curve old"} data-kind="estimate">
      <svg viewBox="0 0 1000 22" preserveAspectRatio="none" role="img" aria-label={words}><title>{words}</title>{limit !== null && <path class="limit" d={`M0 ${y(limit)}H1000`} />}<path d={drawing} /></svg>
      {met !== null && (
        <span class={now ? "crossing held" : "crossing"} role="slider" tabIndex={0} data-at={line.crossing} data-words={keeps} style={{ left: `${100 * place(met)}%`, top: `${y(limit!) - 12}px` }}
          title={`${keeps}, by estimate: press to set it${movable ? "; drag to move the limit, which this half-width then keeps" : ""}`} aria-label={`Limit of ${line.requirement} by ${label}`} aria-disabled={!fresh} aria-valuemin={lowest} aria-valuemax={Math.max(highest, limit!)} aria-valuenow={limit!} aria-valuetext={keeps}
          {...grip({
            track: () => track.current!.getBoundingClientRect(), begin: () => movable && grab(pointer), end: () => void release(label), drop, press: take,
            to: (part) => grab(pointer) && pull(valueOf(line, range[0] * (range[1] / range[0]) ** part)! / line.share),
          })}
          onKeyDown={(event) => {
            if (event.key === "Escape") return drop();
            if (event.key === "Enter" || event.key === " ") take();
            const by = stepsOf(event), end = { Home: lowest, End: highest }[event.key];
            if (by === null && end === undefined && !/^(Enter| )$/.test(event.key)) return;
            event.preventDefault();
            if ((by === null && end === undefined) || !movable || !grab(pointer)) return;
            pull(end ?? held.value!.at + by! * line.step, by === null ? 1 : Math.min(1, Math.abs(by)));
            void release(label, true);
          }} />
      )}
    </span>
  );
}
