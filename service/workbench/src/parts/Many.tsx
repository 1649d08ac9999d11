// Many designs at once: numbers of the design that vary between bounds, what the service makes of a sample of them, all
// as lines over parallel axes; ranges of any axis keep some of them, and one that is pressed is the design on the page.

import { computed, effect, signal, untracked } from "@preact/signals";
import { useEffect, useLayoutEffect, useMemo, useRef, useState } from "preact/hooks";
import { placeOf } from "../advice";
import { answer, current, readRefusal, type Refusal, refused, send, unreachable } from "../api";
import { estimated, standing } from "../readings";
import { type Axis, axesOf, costOf, Crossings, csvOf, keptBy, MOST_AXES, type Range, sobol, valueOf } from "../sample";
import { edit, gesture, type Json, opened, pointerOf, say, settled, withEdits, design } from "../state";
import { brief, duration, readNumber } from "../words";
import { slides } from "./Contributors";
import { copy } from "./Files";
import { Problems } from "./Problems";
import { fileName, save } from "./Reports";
import { Table } from "./Words";
import "./many.css";

// --- what is to vary ---------------------------------------------------------------------------------------------------

const OFFERED = 1000, MOST = 20_000, FIRST = 6; // designs; axes that are there to begin with
const chosen = signal<ReadonlyMap<string, [number, number]> | null>(null); // bounds by axis; null: as they are offered
const wantedCount = signal(OFFERED), seed = signal(1);
const offered = computed(() => axesOf(settled.value, slides(settled.value).map((each) => ({ ...each, label: each.label.replace(/ \(.*\)/, "") }))));

/** By the share of the variance that each has, at the target that decides. */
const shares = computed(() => new Map((estimated.value?.target.contributors ?? []).flatMap((line) => { const path = placeOf(answer.value!.design, line); return path ? [[pointerOf(path), line.variance_share] as const] : []; })));

/** What costs something, else what has the largest shares, and the noise of the beads. */
function firstAxes(): Axis[] {
  const all = offered.value, shareOf = (axis: Axis) => Math.max(0, ...axis.paths.map((path) => shares.value.get(pointerOf(path)) ?? 0)), noise = "/views/*/fiducial_noise_px", priced = costOf(settled.value);
  const costly = (axis: Axis) => Number(priced !== null && priced(new Map([[axis.key, axis.low]])) !== priced(new Map([[axis.key, axis.high]])));
  const ranked = all.filter((axis) => axis.key !== noise && axis.key !== "size" && axis.now > 0 && shareOf(axis) > 0).sort((a, b) => costly(b) - costly(a) || shareOf(b) - shareOf(a)).slice(0, FIRST);
  return all.filter((axis) => ranked.includes(axis) || axis.key === noise);
}
const axes = computed<Axis[]>(() => {
  const held = chosen.value;
  return held ? offered.value.flatMap((axis) => (held.has(axis.key) ? [{ ...axis, low: held.get(axis.key)![0], high: held.get(axis.key)![1] }] : [])) : firstAxes();
});
const choose = (change: (held: Map<string, [number, number]>) => void) => {
  const held = new Map(axes.value.map(({ key, low, high }) => [key, [low, high] as [number, number]]));
  change(held);
  chosen.value = held;
};

// --- the sample --------------------------------------------------------------------------------------------------------

/** A column of the sample: an axis that varies, what the design costs, or what a requirement limits. */
interface Column {
  key: string;
  label: string;
  unit: string;
  log: boolean;
  limit: number | null;
  now: number | null; // of the design that it was drawn about
  values: Float64Array; // NaN: not yet known, or refused
  axis: Axis | null; // null: it is found, not chosen
}
interface Sample {
  of: string; // all of the design but what varies
  seed: number;
  columns: Column[];
  count: number;
  scored: number;
  whys: Map<string, number>; // why designs have no numbers, and how many
  slow: string; // why they are computed one by one
  left: number | null; // seconds
  state: "running" | "waiting" | "stopped" | "done";
  problem: Refusal | null;
}
const sample = signal<Sample | null>(null);
const ranges = signal<ReadonlyMap<string, Range>>(new Map());

/** All of a design but the places of some axes. */
const restOf = (data: Json, varied: readonly (Axis | null)[]) => JSON.stringify(withEdits(data, varied.flatMap((axis) => (axis?.paths ?? []).map((path) => ({ path, value: null })))));
/** Whether the sample is about the design on the page, which may be one of it. */
const fits = computed(() => {
  const of = sample.value, varied = of?.columns.map(({ axis }) => axis) ?? [];
  return of !== null && design.value !== null && varied.every((axis) => !axis || axis.read(design.value) !== null) && restOf(design.value, varied) === of.of;
});

let running: AbortController | null = null;
effect(() => {
  if (!opened.value) return;
  running?.abort();
  chosen.value = sample.value = null;
  ranges.value = new Map();
});
effect(() => {
  if (!fits.value && untracked(() => sample.value?.state) !== "done") untracked(stop);
});

function stop(): void {
  if (!running) return;
  running.abort();
  running = null;
  sample.value = sample.value && { ...sample.value, state: "stopped", left: null };
}

const CELLS = 36_000, LONGEST = 2500, SHORTEST = 8, PIECE_SECONDS = 0.4, AT_A_TIME = 2, AGAIN = 1000; // of one request; ms until one that failed is sent again

/** Draw and score a sample of the present axes; what comes is shown at once. */
async function draw(): Promise<void> {
  running?.abort();
  choose(() => undefined); // the axes that it is drawn of stay, whatever is taken of it
  const left = (running = new AbortController()), data = design.value, varied = axes.value, count = wantedCount.value, checks = answer.value?.score.verdict.checks ?? [];
  const places = sobol(count, varied.length, seed.value), price = costOf(data), unknown = () => new Float64Array(count).fill(NaN);
  const columns: Column[] = varied.map((axis, a) => ({ key: axis.key, label: axis.label, unit: axis.unit, log: axis.log, limit: null, now: axis.now, values: places[a].map((at) => valueOf(axis, at)), axis }));
  if (price) {
    const costs = Float64Array.from({ length: count }, (_, k) => price(new Map(columns.map(({ key, values }) => [key, values[k]])))), known = costs.every(Number.isFinite) && costs.some((cost) => cost !== costs[0]);
    if (known) columns.push({ key: "cost", label: "cost", unit: "", log: true, limit: null, now: price(new Map()), values: costs, axis: null });
  }
  const names = [...new Set(checks.map(({ requirement }) => requirement))].slice(0, 6), found: Column[] = names.length
    ? names.map((name) => { const own = checks.filter(({ requirement }) => requirement === name); return { key: `value:${name}`, label: `${own[0].headline} of ${name}`, unit: own[0].unit, log: false, limit: Math.min(...own.map(({ limit }) => limit)), now: Math.max(...own.map(({ value }) => value)), values: unknown(), axis: null }; })
    : [{ key: "p95_mm", label: "P95", unit: "mm", log: false, limit: null, now: Math.max(...answer.value!.score.targets.map(({ p95_mm: p95 }) => p95)), values: unknown(), axis: null }];
  columns.push(...found);
  ranges.value = new Map(ranges.value.size ? [...ranges.value].filter(([key]) => columns.some((column) => column.key === key)) : found.slice(0, 1).flatMap(({ key, limit }) => (limit === null ? [] : [[key, [-Infinity, limit]] as const])));
  let state: Sample = { of: restOf(data, varied), seed: seed.value, columns, count, scored: 0, whys: new Map(), slow: "", left: null, state: "running", problem: null };
  const tell = (more: Partial<Sample>) => { if (!left.signal.aborted) sample.value = state = { ...state, ...more }; };
  tell({});

  let next = 0, size = SHORTEST; // of a piece: the first says whether the rest goes quickly
  const most = Math.max(1, Math.min(LONGEST, Math.floor(CELLS / varied.reduce((sum, { paths }) => sum + paths.length, 1))));
  const score = async (first: number, rows: number): Promise<void> => {
    const table: Record<string, number[]> = {};
    columns.forEach(({ axis }) => axis?.paths.forEach((path) => (table[pointerOf(path)] = [])));
    for (let k = first; k < first + rows; k += 1) columns.forEach(({ axis, values }) => axis?.place(values[k]).forEach((value, p) => table[pointerOf(axis.paths[p])].push(value)));
    for (;;) {
      const begin = performance.now(), response = await send("POST", "/v1/scores/batch", { design: data, table, columns: [names.length ? "value" : "p95_mm"] }, {}, left.signal).catch(() => null);
      if (left.signal.aborted) return;
      if (!response || response.status === 503 || response.status === 429) {
        tell({ state: "waiting", problem: response ? await readRefusal(response) : unreachable() });
        await new Promise((done) => window.setTimeout(done, 1000 * Number(response?.headers.get("Retry-After") ?? 0) || AGAIN));
        continue;
      }
      if (!response.ok) {
        tell({ state: "stopped", problem: await readRefusal(response), left: null });
        return left.abort();
      }
      const answered = (await response.json()) as { columns: Record<string, Json[]>; why: string };
      const own = found.map(({ key }) => Object.entries(answered.columns).filter(([name]) => name.startsWith(`${key}:`)).map(([, values]) => values as (number | null)[])), whys = new Map(state.whys);
      found.forEach(({ values }, c) => { for (let k = 0; k < rows; k += 1) values[first + k] = own[c].every((each) => each[k] !== null) ? Math.max(...own[c].map((each) => each[k]!)) : NaN; });
      for (const why of answered.columns.reason) if (why) whys.set(why, (whys.get(why) ?? 0) + 1);
      const pace = (1000 * rows) / (performance.now() - begin), scored = state.scored + rows;
      size = answered.why ? Math.min(most, Math.max(SHORTEST, Math.round(pace * PIECE_SECONDS))) : most;
      return tell({ state: "running", problem: null, scored, whys, slow: answered.why, left: (count - scored) / pace / AT_A_TIME });
    }
  };
  await Promise.all(Array.from({ length: AT_A_TIME }, async () => {
    while (next < count && !left.signal.aborted) {
      const first = next, rows = Math.min(size, count - first);
      next += rows;
      await score(first, rows);
    }
  }));
  tell({ state: "done", left: null });
  if (running === left) running = null;
}

// --- what is kept of it ------------------------------------------------------------------------------------------------

const kept = computed(() => (sample.value ? keptBy(sample.value.columns.map(({ values }) => values), sample.value.columns.map(({ key }) => ranges.value.get(key))) : new Uint8Array(0)));
const sortBy = signal<{ key: string; down: boolean } | null>(null);
/** All rows as the table has them: by what costs least, or by what somebody chose. */
const order = computed(() => {
  const columns = sample.value?.columns ?? [], by = columns.find(({ key }) => key === sortBy.value?.key) ?? columns.find(({ key }) => key === "cost") ?? columns[columns.length - 1];
  return by ? Array.from(by.values, (_, row) => row).sort((a, b) => (sortBy.value?.down ? -1 : 1) * (by.values[a] - by.values[b])) : [];
});
const rowsKept = computed(() => order.value.filter((row) => kept.value[row]));

function keep(key: string, range: Range | null): void {
  const held = new Map(ranges.value);
  if (range && (range[0] > -Infinity || range[1] < Infinity)) held.set(key, range);
  else held.delete(key);
  ranges.value = held;
}

/** One of the sample becomes the design on the page: one step, that can be undone. */
function take(row: number): void {
  const { columns, count } = sample.value!;
  edit(columns.flatMap(({ axis, values }) => (axis ? axis.place(values[row]).map((value, p) => ({ path: axis.paths[p], value })) : [])), `Take number ${row + 1} of ${count} designs`);
  say(`Number ${row + 1} of the ${count} designs is on the page: ${wordsOf(row)}. Undo brings back what was there.`);
}

/** What a design of the sample comes to. */
const wordsOf = (row: number) => sample.value!.columns.filter(({ axis }) => !axis).map(({ label, unit, values }) => `${label} ${brief(values[row])} ${unit}`.trim()).join(", ");
const named = ({ label, unit }: { label: string; unit: string }) => (unit ? `${label}, ${unit}` : label);
const csv = () => csvOf(sample.value!.columns.map((column) => (column.axis && column.key !== "size" ? column.key : named(column))), sample.value!.columns.map(({ values }) => values), rowsKept.value);

// --- the picture -------------------------------------------------------------------------------------------------------

const HEIGHT = 230, NEAR = 9, GRIP = 13, SNAP = 4, LEAST = 62; // pixels: of the lines; of a pointer; of an axis; to a limit; between axes
const WIDE = 20; // of the largest over the smallest, from which on an axis is logarithmic

/** From a value of a column to its place from the bottom, 0 to 1, and back. */
function scaleOf({ values, axis, log, limit, now }: Column): { to(value: number): number; from(at: number): number; ends: Range } {
  let [low, high] = axis ? [axis.low, axis.high] : [Infinity, -Infinity];
  if (!axis) {
    for (const value of values) [low, high] = [value < low ? value : low, value > high ? value : high];
    for (const value of [limit, now]) if (value !== null && Number.isFinite(value)) [low, high] = [Math.min(low, value), Math.max(high, value)];
  }
  if (!(high > low)) [low, high] = [low - 1, low + 1];
  const turned = log && low > 0 && (axis || high > WIDE * low) ? [Math.log, Math.exp] : [(v: number) => v, (v: number) => v], [a, b] = [turned[0](low), turned[0](high)];
  return { to: (value) => Math.min(1, Math.max(0, (turned[0](value) - a) / (b - a))), from: (at) => turned[1](a + at * (b - a)), ends: [low, high] };
}

/** The last part of a name, which tells axes apart, and the rest of it. */
function NameOf({ label, unit }: Column) {
  const parts = label.split(", "), last = parts.pop()!;
  return <><span>{parts.join(", ")}</span><strong>{named({ label: last, unit })}</strong></>;
}

/** What a colour of the page is, as three numbers. */
function rgb(name: string): number[] {
  const hex = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  return [0, 1, 2].map((k) => parseInt(hex.length < 7 ? hex[k + 1].repeat(2) : hex.slice(2 * k + 1, 2 * k + 3), 16));
}

function Lines({ of }: { of: Sample }) {
  const box = useRef<HTMLDivElement>(null), canvas = useRef<HTMLCanvasElement>(null), crossings = useRef<Crossings | null>(null), [room, setRoom] = useState(600), [theme, setTheme] = useState(0), [near, setNear] = useState<number | null>(null);
  const { columns } = of, width = Math.max(room, LEAST * columns.length), edge = width / columns.length / 2, xs = columns.map((_, k) => Math.round(edge + (k * (width - 2 * edge)) / (columns.length - 1))), scales = useMemo(() => columns.map(scaleOf), [of]), now = fits.value;
  const y = (c: number, value: number) => (HEIGHT - 1) * (1 - scales[c].to(value));
  useEffect(() => {
    const seen = new ResizeObserver(([entry]) => setRoom(Math.floor(entry.contentRect.width))), turned = new MutationObserver(() => setTheme((k) => k + 1));
    seen.observe(box.current!);
    turned.observe(document.documentElement, { attributeFilter: ["data-theme"] });
    return () => { seen.disconnect(); turned.disconnect(); };
  }, []);
  useLayoutEffect(() => {
    crossings.current = new Crossings(xs, HEIGHT, columns.map(({ values }, c) => Int16Array.from(values, (value) => (Number.isFinite(value) ? Math.round(y(c, value)) : -1))));
  }, [of, width]);
  useLayoutEffect(() => {
    const at = canvas.current!.getContext("2d")!, image = at.createImageData(xs[xs.length - 1] + 1, HEIGHT);
    crossings.current!.show(kept.value);
    crossings.current!.paint(image.data, image.width, { all: rgb("--rule"), kept: rgb("--bead") });
    at.putImageData(image, 0, 0);
  }, [of, width, theme, kept.value]);

  /** The kept design whose line is nearest to a place; null where none is near. */
  const nearest = (x: number, at: number): number | null => {
    const g = xs.findIndex((right, k) => k > 0 && x <= right) - 1;
    if (g < 0 || x < xs[0]) return null;
    const part = (x - xs[g]) / (xs[g + 1] - xs[g]);
    let best = NEAR, found: number | null = null;
    kept.value.forEach((one, row) => {
      const away = one ? Math.abs((1 - part) * y(g, columns[g].values[row]) + part * y(g + 1, columns[g + 1].values[row]) - at) : Infinity;
      if (away < best) [best, found] = [away, row];
    });
    return found;
  };
  const path = (values: (number | null)[]) => (values.every((value) => value !== null && Number.isFinite(value)) ? `M${values.map((value, c) => `${xs[c]} ${y(c, value!).toFixed(1)}`).join("L")}` : "");
  const present = now && current.value ? columns.map(nowOf) : [];
  const place = (event: PointerEvent & { currentTarget: SVGElement }) => { const { left, top } = event.currentTarget.ownerSVGElement?.getBoundingClientRect() ?? event.currentTarget.getBoundingClientRect(); return [event.clientX - left, event.clientY - top]; };
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label="Lines of the designs">
      <div ref={box} />
      <div class="many" style={{ width: `${width}px` }}>
        <div class="names">{columns.map((column) => <div key={column.key} style={{ width: `${width / columns.length}px` }} class={column.axis ? "" : "found"} title={named(column)}><NameOf {...column} /></div>)}</div>
        <div class="field">
          <canvas ref={canvas} width={xs[xs.length - 1] + 1} height={HEIGHT} />
          <svg width={width} height={HEIGHT + 16} role="img" aria-label={`${of.scored} designs as lines over ${columns.map(({ label }) => label).join("; ")}. The table below has those that are kept.`}
            onPointerMove={(event) => setNear(now && event.pointerType === "mouse" && !event.buttons && !(event.target as Element).closest(".axis") ? nearest(...(place(event) as [number, number])) : null)} onPointerLeave={() => setNear(null)}
            onClick={(event) => { const { left, top } = event.currentTarget.getBoundingClientRect(), row = now ? nearest(event.clientX - left, event.clientY - top) : null; if (row !== null && !(event.target as Element).closest(".axis")) take(row); }}>
            {columns.map((column, c) => <AxisLine key={column.key} column={column} x={xs[c]} scale={scales[c]} />)}
            {present.length > 0 && <path class="present" d={path(present)} />}
            {near !== null && kept.value[near] ? <path class="near" d={path(columns.map(({ values }) => values[near]))} /> : null}
          </svg>
        </div>
      </div>
      <p class="note near">{near !== null && kept.value[near] ? `Number ${near + 1}: ${wordsOf(near)}. Press to take it.` : now ? "Drag along an axis to keep a part of it, press it to keep all; press a line to take that design. The thick line is the design on the page." : " "}</p>
    </div>
  );
}

/** What the design on the page has in a column. */
function nowOf({ key, axis }: Column): number | null {
  if (axis || key === "cost") return axis ? axis.read(settled.value) : costOf(settled.value)?.(new Map()) ?? null;
  const { verdict, targets } = answer.value!.score, own = key === "p95_mm" ? targets.map(({ p95_mm: p95 }) => p95) : verdict.checks.filter(({ requirement }) => key === `value:${requirement}`).map(({ value }) => value);
  return own.length ? Math.max(...own) : null;
}

/** An axis with its ends, its limit, and the part of it that is kept: dragged along it; pressed, all of it is. */
function AxisLine({ column, x, scale }: { column: Column; x: number; scale: ReturnType<typeof scaleOf> }) {
  const begin = useRef<number | null>(null), range = ranges.value.get(column.key), y = (value: number) => (HEIGHT - 1) * (1 - scale.to(value)), [low, high] = scale.ends;
  const at = (event: PointerEvent & { currentTarget: SVGElement }) => Math.min(1, Math.max(0, 1 - (event.clientY - event.currentTarget.ownerSVGElement!.getBoundingClientRect().top) / (HEIGHT - 1)));
  const near = (place: number) => column.limit !== null && Math.abs(place - scale.to(column.limit)) * HEIGHT < SNAP; // the limit itself
  const value = (place: number) => (place <= 0 ? -Infinity : place >= 1 ? Infinity : near(place) ? column.limit! : Number(scale.from(place).toPrecision(4)));
  return (
    <g class="axis">
      <path d={`M${x} 0V${HEIGHT - 1}`} />
      {column.limit !== null && <path class="limit" d={`M${x - 10} ${y(column.limit)}h20`} />}
      {range && <rect class="brush" x={x - 7} width={14} y={y(Math.min(range[1], high))} height={Math.max(2, y(Math.max(range[0], low)) - y(Math.min(range[1], high)))} />}
      <text x={x + 4} y={10}>{brief(Number(high.toPrecision(3)))}</text><text x={x + 4} y={HEIGHT + 12}>{brief(Number(low.toPrecision(3)))}</text>
      <rect class="grip" x={x - GRIP} width={2 * GRIP} height={HEIGHT}
        onPointerDown={(event) => { event.currentTarget.setPointerCapture(event.pointerId); begin.current = at(event); }}
        onPointerMove={(event) => {
          if (begin.current === null || Math.abs(at(event) - begin.current) * HEIGHT < 3) return;
          const [a, b] = [begin.current, at(event)].sort((p, q) => p - q);
          keep(column.key, [value(a), value(b)]);
        }}
        onPointerUp={(event) => { if (begin.current !== null && Math.abs(at(event) - begin.current) * HEIGHT < 3) keep(column.key, null); begin.current = null; }}
        onPointerCancel={() => (begin.current = null)} />
    </g>
  );
}

/** Where in the volume: designs by two coordinates of a target that vary, the darker the larger what decides. */
function Where({ of }: { of: Sample }) {
  const canvas = useRef<HTMLCanvasElement>(null), found = of.columns.find(({ axis, key }) => !axis && key !== "cost")!, at = /^\/targets\/(\d+)\/position_mm\/[012]$/;
  const own = of.columns.filter(({ key }) => at.test(key)), [across, up] = own.filter(({ key }) => at.exec(key)![1] === at.exec(own[0].key)![1]);
  const scale = up && [across, up, { ...found, limit: null, now: null }].map(scaleOf), SIDE = 300;
  useLayoutEffect(() => {
    if (!scale) return;
    const ink = canvas.current!.getContext("2d")!, ground = rgb("--ground"), within = rgb("--bead"), beyond = rgb("--fail-edge"), cell = Math.max(3, Math.ceil((2 * SIDE) / Math.sqrt(of.scored + 1)));
    ink.clearRect(0, 0, SIDE, SIDE);
    for (let row = 0; row < of.count; row += 1) {
      const value = found.values[row], dark = 0.15 + 0.85 * scale[2].to(value);
      if (!kept.value[row] && (ranges.value.size === 0 || Number.isNaN(value) || !keptBut(of, row, found.key))) continue;
      ink.fillStyle = `rgb(${(found.limit !== null && value > found.limit ? beyond : within).map((c, k) => Math.round(ground[k] + dark * (c - ground[k]))).join()})`;
      ink.fillRect(scale[0].to(across.values[row]) * SIDE - cell / 2, (1 - scale[1].to(up.values[row])) * SIDE - cell / 2, cell, cell);
    }
  });
  if (!scale) return null;
  const [[left, right], [low, high], [least, most]] = scale.map(({ ends }) => ends);
  return (
    <figure class="where">
      <figcaption>{`${named(found)} by ${across.label} (${brief(left)} to ${brief(right)}, to the right) and ${up.label} (${brief(low)} to ${brief(high)}, upwards), ${across.unit}: from ${brief(least)} (light) to ${brief(most)} (dark)${found.limit === null ? "" : `; red is beyond ${brief(found.limit)}`}. What the other axes keep.`}</figcaption>
      <canvas ref={canvas} width={SIDE} height={SIDE} role="img" aria-label={`Map of ${named(found)} over ${across.label} and ${up.label}; the table below has its numbers.`} />
    </figure>
  );
}
const keptBut = (of: Sample, row: number, but: string) => of.columns.every(({ key, values }) => { const [low, high] = ranges.value.get(key) ?? [-Infinity, Infinity]; return key === but || (values[row] >= low && values[row] <= high); });

// --- numbers that are typed ----------------------------------------------------------------------------------------------

/** A number that takes effect on Enter or when the field is left; empty where there is none. */
function Typed({ label, value, take, none = "" }: { label: string; value: number | null; take(value: number | null): boolean; none?: string }) {
  const [wrong, setWrong] = useState(false), shown = value === null || !Number.isFinite(value) ? "" : String(value);
  const typed = (field: HTMLInputElement) => {
    const number = readNumber(field.value), empty = field.value.trim() === "";
    setWrong(field.value !== shown && !(empty && none ? take(null) : number !== null && take(number)));
  };
  return <input key={shown} type="text" inputMode="decimal" aria-label={label} placeholder={none} defaultValue={shown} aria-invalid={wrong} onInput={() => setWrong(false)} onBlur={(event) => typed(event.currentTarget)} onKeyDown={(event) => event.key === "Enter" && typed(event.currentTarget)} />;
}

/** The target that decides, its x and y alone. */
function MapOf() {
  const name = estimated.value?.target.name, k = (settled.value?.targets ?? []).findIndex((target: Json) => target?.name === name), own = offered.value.filter(({ key }) => key === `/targets/${k}/position_mm/0` || key === `/targets/${k}/position_mm/1`);
  return own.length < 2 ? null : <button type="button" class="small" onClick={() => (chosen.value = new Map(own.map(({ key, low, high }) => [key, [low, high]])))}>{`Only x and y of ${name}: a map`}</button>;
}

/** Which numbers vary between which bounds, and what is kept of each axis. */
function Axes() {
  const found = sample.value?.columns.filter(({ axis }) => !axis) ?? [], rest = offered.value.filter(({ key }) => !axes.value.some((axis) => axis.key === key));
  const drawn = (key: string) => fits.value && sample.value!.columns.some((column) => column.key === key);
  const kept = (key: string, label: string) => {
    const [low, high] = ranges.value.get(key) ?? [-Infinity, Infinity];
    return [
      <td key="low">{drawn(key) && <Typed label={`keep ${label} from`} value={low} none="all" take={(value) => (value ?? -Infinity) <= high && (keep(key, [value ?? -Infinity, high]), true)} />}</td>,
      <td key="high">{drawn(key) && <Typed label={`keep ${label} up to`} value={high} none="all" take={(value) => (value ?? Infinity) >= low && (keep(key, [low, value ?? Infinity]), true)} />}</td>,
    ];
  };
  const bound = (axis: Axis, end: 0 | 1) => (value: number | null) => {
    const next: [number, number] = end ? [axis.low, value ?? NaN] : [value ?? NaN, axis.high], good = next[0] < next[1] && (!axis.log || next[0] > 0);
    if (good) choose((held) => held.set(axis.key, next));
    return good;
  };
  return (
    <>
      <Table name="Axes" look="axes" head={<><th>Axis</th><th class="number">Now</th><th>Drawn from</th><th>to</th><th>Kept from</th><th>to</th><th><span class="hidden">Leave it out</span></th></>}>
        {axes.value.map((axis) => (
          <tr key={axis.key}>
            <th scope="row">{named(axis)}</th><td class="number">{brief(axis.now)}</td>
            <td><Typed label={`draw ${axis.label} from`} value={axis.low} take={bound(axis, 0)} /></td><td><Typed label={`draw ${axis.label} up to`} value={axis.high} take={bound(axis, 1)} /></td>
            {kept(axis.key, axis.label)}
            <td><button type="button" class="small" aria-label={`Leave ${axis.label} as it is`} onClick={() => choose((held) => held.delete(axis.key))}>×</button></td>
          </tr>
        ))}
        {found.map((column) => <tr key={column.key}><th scope="row">{named(column)}</th><td class="number">{brief(nowOf(column))}</td><td colSpan={2} class="note">found</td>{kept(column.key, column.label)}<td /></tr>)}
      </Table>
      {rest.length > 0 && axes.value.length < MOST_AXES && (
        <p class="controls"><label>Let vary, too{" "}<select value="" onChange={(event) => { const axis = rest.find(({ key }) => key === event.currentTarget.value); if (axis) choose((held) => held.set(axis.key, [axis.low, axis.high])); event.currentTarget.value = ""; }}>
          <option value="">choose …</option>{rest.map((axis) => <option key={axis.key} value={axis.key}>{named(axis)}</option>)}
        </select></label>{" "}<MapOf /></p>
      )}
    </>
  );
}

// --- the table and the whole ---------------------------------------------------------------------------------------------

const PAGE = 15;
function Kept({ of }: { of: Sample }) {
  const [shown, show] = useState(PAGE), rows = rowsKept.value, by = sortBy.value;
  return (
    <>
      <p class="controls">
        <strong role="status">{`${rows.length} of ${of.scored} kept`}</strong>{of.scored > 0 && !rows.length && <span class="note">widen a range above</span>}
        {ranges.value.size > 0 && <button type="button" class="small" onClick={() => (ranges.value = new Map())}>Keep all</button>}
        <button type="button" class="small" disabled={!rows.length} onClick={() => copy(csv(), `${rows.length} designs copied as CSV.`)}>Copy as CSV</button>
        <button type="button" class="small" disabled={!rows.length} onClick={() => save(new Blob([csv()], { type: "text/csv" }), `${fileName()}.designs.csv`)}>Save as CSV</button>
      </p>
      <Table name="Designs that are kept" head={<><th>Number</th>{of.columns.map((column) => (
        <th key={column.key} class="number" aria-sort={by?.key === column.key ? (by.down ? "descending" : "ascending") : undefined}><button type="button" class="sort" onClick={() => (sortBy.value = { key: column.key, down: by?.key === column.key && !by.down })}>{named(column)}{by?.key === column.key ? (by.down ? " ▼" : " ▲") : ""}</button></th>
      ))}</>}>
        {rows.slice(0, shown).map((row) => (
          <tr key={row}><th scope="row"><button type="button" class="small" disabled={!fits.value} onClick={() => take(row)}>{`Take ${row + 1}`}</button></th>{of.columns.map(({ key, values }) => <td key={key} class="number">{brief(values[row])}</td>)}</tr>
        ))}
      </Table>
      {rows.length > shown && <p><button type="button" class="small" onClick={() => show(shown + 10 * PAGE)}>{`Show more of ${rows.length}`}</button></p>}
    </>
  );
}

export function Many() {
  const of = sample.value, busy = of?.state === "running" || of?.state === "waiting", old = of !== null && !fits.value;
  const why = refused.value ? "The design cannot be scored as it is: the strip says why. Mend that first." : !answer.value ? "It waits for the first score." : !axes.value.length ? "Nothing varies: choose an axis." : "";
  const whys = [...(of?.whys ?? [])].sort((a, b) => b[1] - a[1]);
  return (
    <div data-kind="estimate">
      <p class="note">Numbers of the design vary between bounds, by a low-discrepancy sequence; each design is scored by the estimate. Cost is that of the design's own cost curves and grades{costOf(settled.value) ? "." : ", of which it states none (under optimise)."}</p>
      <Axes />
      <p class="controls">
        <button type="button" disabled={why !== "" || !current.value || gesture.value.length > 0} onClick={() => void draw()}>{`Score ${wantedCount.value} designs`}</button>
        <label>Designs <Typed label="how many designs" value={wantedCount.value} take={(value) => value !== null && Number.isInteger(value) && value >= 2 && value <= MOST && ((wantedCount.value = value), true)} /></label>
        <label>Seed <Typed label="seed" value={seed.value} take={(value) => value !== null && Number.isInteger(value) && value >= 0 && ((seed.value = value), true)} /></label>
        {busy && <><button type="button" onClick={stop}>Stop</button><progress aria-label="designs that are scored" max={of.count} value={of.scored} /><span class="note" role="status">{of.left !== null && of.left > 2 ? `about ${duration(of.left)} left` : ""}</span></>}
      </p>
      {why && <p class="note">{why}</p>}
      {!standing.value.holds && standing.value.words && <p class="note">{standing.value.words}</p>}
      {of?.problem && <Problems problem={of.problem} />}
      {of?.slow && <p class="note">{`Computed one by one, which takes long: ${of.slow}.`}</p>}
      {whys.length > 0 && <p class="note">{`${whys.reduce((sum, [, count]) => sum + count, 0)} could not be scored, and have no line; for example: ${whys[0][0]}`}</p>}
      {old && <p class="remark">These are of the design as it was: something else than what varies has changed since. Score them again.</p>}
      {of && (
        <div class={old ? "old" : ""}>
          <Lines of={of} />
          {of.scored > 0 && <Where of={of} />}
          <Kept of={of} />
          <p class="note">{`${of.scored} of ${of.count} designs, Sobol's sequence, seed ${of.seed}${of.state === "stopped" ? "; stopped" : ""}.`}</p>
        </div>
      )}
    </div>
  );
}
