// What is limited over each half-width, under its slider, and where it meets the limit: one request for all of them.

import { effect, signal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { current, pathOf, refused, send } from "../api";
import { answering, decimals, known, standing } from "../readings";
import { design, edit, gesture, type Json, pointerOf, recall, remember, settled, valueAt } from "../state";
import { brief, mm } from "../words";

type Range = [number, number];
type Values = (number | null)[];
interface Line {
  at: number[]; // half-widths
  values: Values; // of what is limited, at the worst target; null where there is none
  crossing: number | null; // the half-width at which it meets the limit
}
interface Lines {
  design: Json; // of which they are
  limit: number | null;
  unit: string;
  of: Map<string, Line>; // by pointer
}

export const drawn = signal(recall("tailstack.workbench.curves", false));
effect(() => void remember("tailstack.workbench.curves", drawn.value));
const lines = signal<Lines | null>(null);
const wanted = new Map<string, Range>(), asked = signal(0); // sliders in sight, and that there are others
const QUIET = 300, POINTS = 25, FINER = 17, ROUNDS = 2, MOST = 40;

effect(() => {
  const data = design.value, held = lines.value, has = held && held.design === data ? held.of : null;
  if (asked.value < 0 || !drawn.value || !current.value || refused.value || gesture.value.length || !standing.value.holds || [...wanted.keys()].every((pointer) => has?.has(pointer))) return;
  const timer = window.setTimeout(() => void look(data), QUIET);
  return () => window.clearTimeout(timer);
});

const between = (low: number, high: number, count: number) => Array.from({ length: count }, (_, k) => low * (high / low) ** (k / (count - 1)));

async function look(data: Json): Promise<void> {
  const check = answering(known.value), limit = check?.limit ?? null, begin = check ? `value:${check.requirement}:` : "p95_mm";
  if ((known.value.estimate?.record.targets.length ?? 0) > MOST) return;
  /** What is limited at each of these half-widths by itself. */
  const valuesAt = async (grids: Map<string, number[]>): Promise<Map<string, Values> | null> => {
    const rows = [...grids].flatMap(([pointer, at]) => at.map((value) => ({ pointer, value })));
    const table = Object.fromEntries([...grids.keys()].map((pointer) => [pointer, rows.map((row) => (row.pointer === pointer ? row.value : valueAt(data, pathOf(pointer))))]));
    const response = await send("POST", "/v1/scores/batch", { design: data, table, columns: [check ? "value" : "p95_mm"] }).catch(() => null);
    if (!response?.ok || design.value !== data) return null;
    const { columns } = (await response.json()) as { columns: Record<string, Values> }, own = Object.keys(columns).filter((name) => name.startsWith(begin));
    const worst = rows.map((_, k) => { const each = own.map((name) => columns[name][k]); return each.length && each.every((value) => value !== null) ? Math.max(...(each as number[])) : null; });
    let k = 0;
    return new Map([...grids].map(([pointer, at]) => [pointer, worst.slice(k, (k += at.length))]));
  };
  let grids = new Map([...wanted].map(([pointer, range]) => [pointer, between(...range, POINTS)])), values = await valuesAt(grids);
  if (!values) return;
  const of = new Map<string, Line>([...grids].map(([pointer, at]) => [pointer, { at, values: values!.get(pointer)!, crossing: null }]));
  for (let round = 0; limit !== null && grids.size; round += 1) {
    const ends = [...grids].flatMap(([pointer, at]) => {
      const each = values!.get(pointer)!, k = each.findIndex((value, j) => j + 1 < at.length && value !== null && each[j + 1] !== null && (value - limit) * (each[j + 1]! - limit) <= 0 && value !== each[j + 1]);
      return k < 0 ? [] : [{ pointer, low: at[k], high: at[k + 1], from: each[k]!, to: each[k + 1]! }];
    });
    for (const { pointer, low, high, from, to } of ends) of.get(pointer)!.crossing = low + ((high - low) * (limit - from)) / (to - from);
    if (round === ROUNDS) break;
    grids = new Map(ends.map(({ pointer, low, high }) => [pointer, between(low, high, FINER)]));
    if (grids.size && !(values = await valuesAt(grids))) return;
  }
  if (design.value === data) lines.value = { design: data, limit, unit: check?.unit ?? "mm", of };
}

/** The half-width at which the limit is met, rounded to its side, three digits; null where it is not known of this design. */
export function crossingOf(pointer: string): number | null {
  const crossing = drawn.value && lines.value?.design === settled.value ? lines.value?.of.get(pointer)?.crossing ?? null : null;
  if (crossing === null) return null;
  const worth = 10 ** (Math.floor(Math.log10(crossing)) - 2);
  return Number((Math.floor(crossing / worth) * worth).toPrecision(3));
}

/** The curve on the slider's own scale; ``place``: from a half-width to its place there, 0 to 1. */
export function Curve({ pointer, label, unit, range, place }: { pointer: string; label: string; unit: string; range: Range; place(value: number): number }) {
  useEffect(() => {
    wanted.set(pointer, range);
    asked.value += 1;
    return () => void wanted.delete(pointer);
  }, [pointer]);
  const all = lines.value, line = all?.of.get(pointer), fresh = all?.design === settled.value && gesture.value.every(({ path }) => pointerOf(path) === pointer);
  if (!drawn.value) return null;
  if (!line) return <span class="curve" />;
  const { limit } = all!, near = line.values.filter((value): value is number => value !== null), low = 0.97 * Math.min(...near, limit ?? Infinity), top = 1.5 * (limit ?? Math.min(...near)), y = (value: number) => 21 - (20 * Math.min(value - low, 2 * top)) / (top - low), met = crossingOf(pointer);
  const path = line.at.reduce((path, at, k) => (line.values[k] === null ? path : `${path}${k && line.values[k - 1] !== null ? "L" : "M"}${(1000 * place(at)).toFixed(1)} ${y(line.values[k]!).toFixed(2)}`), "");
  const words = `${label}: ${mm(Math.min(...near), decimals.value)} ${all!.unit} at best${limit === null ? "" : met === null ? ", the limit is not met by it alone" : `, the limit is met at ${brief(met)} ${unit}`}`;
  return (
    <span class={fresh ? "curve" : "curve old"} data-kind="estimate">
      <svg viewBox="0 0 1000 22" preserveAspectRatio="none" role="img" aria-label={words}><title>{words}</title>{limit !== null && <path class="limit" d={`M0 ${y(limit)}H1000`} />}<path d={path} /></svg>
      {met !== null && <button type="button" class="crossing" data-at={line.crossing} style={{ left: `${100 * place(met)}%`, top: `${y(limit!) - 12}px` }} title={`the limit is met at ${brief(met)} ${unit}: press to set it`} aria-label={`${label} to its limit, ${brief(met)} ${unit}`} disabled={!fresh || met === valueAt(design.value, pathOf(pointer))} onClick={() => edit([{ path: pathOf(pointer), value: met }], `${label} to its limit`)} />}
    </span>
  );
}
