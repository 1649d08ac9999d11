// One number of the design over a range: which, from where to where; and what came of it, as curves and as a table.

import { computed, signal } from "@preact/signals";
import { useMemo } from "preact/hooks";
import type { components } from "../../../../openapi/typescript/tailstack";
import { pathOf, placeInWords } from "../api";
import { roundStep } from "../geometry";
import { type Run, start } from "../jobs";
import { axesOf } from "../sample";
import { design, edit, type Json, parse, type Path, pointerOf, settled, text, valueAt, withEdits } from "../state";
import { brief, countDecimals, mm, readNumber, stated, VERDICTS } from "../words";
import { slides } from "./Contributors";
import { Table } from "./Words";

type Record = components["schemas"]["Sweep"];
type Point = Record["points"][number];

// --- which number ------------------------------------------------------------------------------------------------------

interface Choice {
  key: string; // its pointer
  words: string;
  low: number;
  high: number;
  log: boolean;
}
const POINTS = 15, REACH = 20, MOST_OFFERED = 400; // points; on either side of a number that is none of a spread
const chosen = signal(""), bounds = signal<[string, string, string]>(["", "", String(POINTS)]);

function numbersIn(part: Json, path: Path = []): Path[] {
  if (typeof part === "number") return [path];
  return part === null || typeof part !== "object" ? [] : Object.entries(part).flatMap(([name, value]) => (path.length === 0 && name === "optimise" ? [] : numbersIn(value, [...path, Array.isArray(part) ? Number(name) : name])));
}
/** What spreads, by name, and every number of the design. */
const offered = computed<[string, Choice[]][]>(() => {
  const data = design.value, spreads = axesOf(data, slides(data)).filter(({ key }) => key !== "size").map(({ key, label, unit, low, high, log }) => ({ key, words: unit ? `${label}, ${unit}` : label, low, high, log }));
  const all = numbersIn(data).slice(0, MOST_OFFERED).map((path) => {
    const key = pointerOf(path), now = valueAt(data, path) as number, log = now > 0 && /half_width|noise|std|limit|distance|diameter/.test(key);
    return { key, words: placeInWords(data, key), low: log ? Number((now / 2).toPrecision(3)) : now - REACH, high: log ? 2 * now : now + REACH, log };
  });
  return [["Half-widths, noise, targets", spreads], ["Every number", all]];
});
const choiceOf = (key: string) => offered.value.flatMap(([, some]) => some).find((each) => each.key === key);

function choose(key: string): void {
  chosen.value = key;
  const found = choiceOf(key);
  if (found) bounds.value = [String(found.low), String(found.high), bounds.value[2]];
}

export function SweepForm() {
  return (
    <form class="controls" onSubmit={(event) => {
      event.preventDefault();
      const fields = [...event.currentTarget.querySelectorAll("input")], numbers = fields.map((field) => readNumber(field.value)), [from, to, count] = numbers, { log, words } = choiceOf(chosen.value) ?? { log: false, words: chosen.value };
      numbers.forEach((value, k) => fields[k].setCustomValidity(value === null ? "a number is written 0.1 or 0,1" : k === 2 && !(Number.isInteger(value) && value > 1) ? "how many points: a whole number, 2 or more" : ""));
      if (!event.currentTarget.reportValidity()) return;
      const even = Array.from({ length: count! }, (_, k) => k / (count! - 1)), values = even.map((part) => Number((log && from! > 0 && to! > 0 ? from! * (to! / from!) ** part : from! + part * (to! - from!)).toPrecision(4)));
      void start(`Sweep ${words}`, "/v1/sweeps", { axes: [{ pointer: chosen.value, values }] });
    }}>
      <label><span>Number</span>{" "}
        <select aria-label="Number" value={chosen.value} required onChange={(event) => choose(event.currentTarget.value)}>
          <option value="">choose …</option>
          {offered.value.map(([group, some]) => <optgroup key={group} label={group}>{some.map(({ key, words }) => <option key={key} value={key}>{words}</option>)}</optgroup>)}
        </select>
      </label>
      {(["from", "to", "points"] as const).map((name, k) => (
        <label key={name}>{name} <input type="text" inputMode="decimal" size={6} required value={bounds.value[k]} onInput={(event) => { event.currentTarget.setCustomValidity(""); bounds.value = bounds.value.map((each, n) => (n === k ? event.currentTarget.value : each)) as [string, string, string]; }} /></label>
      ))}
      {choiceOf(chosen.value)?.log && <span class="note">in even ratios</span>}
      <button type="submit">Sweep</button>
    </form>
  );
}

// --- what came of it ---------------------------------------------------------------------------------------------------

/** Where a pointer leads; a step * stands for every element. */
const placesOf = (data: Json, pointer: string): Path[] =>
  pathOf(pointer).reduce<Path[]>((found, step) => found.flatMap((path) => (step === "*" ? Object.keys(valueAt(data, path) ?? {}).map((key) => [...path, Array.isArray(valueAt(data, path)) ? Number(key) : key]) : [[...path, step]])), [[]])
    .filter((path) => typeof valueAt(data, path) === "number");

/** All of a text but the numbers that a sweep varies. */
const restOf = (data: Json, { axes }: Record) => JSON.stringify(withEdits({ ...data, review: null }, axes.flatMap(({ pointer }) => placesOf(data, pointer).map((path) => ({ path, value: null })))));

interface Curve {
  name: string;
  points: { x: number; y: number | null; low?: number; high?: number; of: Point }[];
}
const MOST_CURVES = 6, worst = (of: Point) => [...of.targets].sort((a, b) => b.p95_mm - a.p95_mm)[0];
/** Targets are curves where one axis varies; where two do, the values of the shorter one, at the worst target. */
function curvesOf({ axes, points }: Record): { along: number; curves: Curve[]; left: number } | null {
  const wide = axes.map((_, k) => k).filter((k) => new Set(axes[k].values).size > 1), [along, other] = [...wide].sort((a, b) => axes[b].values.length - axes[a].values.length || b - a);
  if (wide.length < 1 || wide.length > 2) return null;
  const sorted = [...points].sort((a, b) => a.values[along] - b.values[along]), pointOf = (of: Point, target: Point["targets"][number] | undefined) => ({ x: of.values[along], y: target?.p95_mm ?? null, low: target?.p95_interval_mm?.[0], high: target?.p95_interval_mm?.[1], of });
  const names = [...new Set(points.flatMap(({ targets }) => targets.map(({ name }) => name)))];
  const all = other === undefined
    ? names.map((name) => ({ name, points: sorted.map((of) => pointOf(of, of.targets.find((target) => target.name === name))) }))
    : [...new Set(axes[other].values)].map((value) => ({ name: `${brief(value)} ${axes[other].unit}`.trim(), points: sorted.filter((of) => of.values[other] === value).map((of) => pointOf(of, worst(of))) }));
  const most = (curve: Curve) => Math.max(0, ...curve.points.map(({ y }) => y ?? 0)), curves = all.sort((a, b) => most(b) - most(a)).slice(0, MOST_CURVES);
  return { along, curves, left: all.length - curves.length };
}

/** As the list of contributors calls it, where it is one of them. */
const nameOf = ({ name, pointer, unit }: Record["axes"][number]) => offered.value[0][1].find(({ key }) => key === pointer)?.words ?? [name || pointer, unit].filter(Boolean).join(", ");
/** 1, 2 and 5 of each decade between two. */
function decadesOf(low: number, high: number): number[] {
  const all = [1, 2, 5].flatMap((f) => Array.from({ length: 20 }, (_, k) => Number(`${f}e${k - 10}`))).filter((value) => value >= low * 0.999 && value <= high * 1.001);
  return all.length > 7 ? all.filter((value) => String(value.toExponential()).startsWith("1")) : all;
}
/** Round numbers between two, so many or fewer. */
function ticksOf(low: number, high: number, most: number): number[] {
  const step = [1, 2, 5, 10].map((f) => f * roundStep((high - low) / most)).find((each) => (high - low) / each <= most)!;
  return Array.from({ length: most + 1 }, (_, k) => Number(((Math.ceil(low / step - 1e-9) + k) * step).toPrecision(10))).filter((value) => value <= high + 1e-9 * step);
}

export function Swept({ run, result }: { run: Run; result: Record }) {
  const other = useMemo(() => run.text !== "" && run.text !== text.value && restOf(parse(run.text).data, result) !== restOf(settled.value, result), [run.text, text.value]);
  const { points, axes } = result, drawn = curvesOf(result), d = Math.max(0, ...points.flatMap(({ targets }) => targets.map((target) => countDecimals(target.limit_mm ?? target.p95_mm)))), refused = points.filter(({ status }) => status === "refused");
  const places = axes.map(({ pointer }) => placesOf(settled.value, pointer)), kind = result.check === "score" ? "estimate" : "simulation", how = result.check === "score" ? "by estimate" : "by simulation";
  const isNow = ({ values }: Point) => places.every((some, k) => some.length > 0 && some.every((path) => valueAt(settled.value, path) === values[k]));
  const take = ({ values }: Point) => edit(places.flatMap((some, k) => some.map((path) => ({ path, value: values[k] }))), `Take ${axes.map((axis, k) => `${nameOf(axis)} ${brief(values[k])}`).join(", ")}`);
  const columns = drawn && axes.length === 1 ? drawn.curves.map(({ name }) => name) : null, usable = !other && places.every((some) => some.length > 0);
  return (
    <div class={other ? "old" : ""} data-kind={kind}>
      {drawn && drawn.curves.some((curve) => curve.points.some(({ y }) => y !== null)) && <Plot of={result} {...drawn} how={how} digits={d} isNow={isNow} take={usable ? take : null} />}
      {refused.length > 0 && <p class="note">{`${refused.length} of ${points.length} points were refused; ${axes.map((axis, k) => `${nameOf(axis)} ${brief(refused[0].values[k])}`).join(", ")}: ${refused[0].reason}`}</p>}
      <Table name="Sweep" of="swept" caption={<>{`P95 of the error at the tool, mm, ${how}${columns ? "" : ", at the target where it is largest"}`}</>} head={<>{axes.map((axis) => <th key={axis.pointer}>{nameOf(axis)}</th>)}{(columns ?? ["P95"]).map((name) => <th key={name} class="number">{name}</th>)}<th>Status</th><th><span class="hidden">Take it</span></th></>}>
        {points.slice(0, 200).map((of, k) => (
          <tr key={k} class={isNow(of) ? "chosen" : ""}>
            {of.values.map((value, n) => (n ? <td key={n}>{stated(value, 0)}</td> : <th key={n} scope="row">{stated(value, 0)}</th>))}
            {(columns ?? [null]).map((name) => <td key={name} class="number">{mm((name === null ? worst(of) : of.targets.find((target) => target.name === name))?.p95_mm, d)}</td>)}
            <td class={`status ${of.verdict ?? ""}`}>{of.verdict ? VERDICTS[of.verdict] : of.status}</td>
            <td>{isNow(of) ? "now" : <button type="button" class="small" disabled={!usable || of.status === "refused"} aria-label={`Take ${of.values.map(brief).join(", ")}`} onClick={() => take(of)}>take</button>}</td>
          </tr>
        ))}
      </Table>
    </div>
  );
}

const WIDE = 360, TALL = 170, LEFT = 40, RIGHT = 300, TOP = 14, DASHES = ["", "6 3", "2 2", "8 2 2 2", "1 3", "10 4"];
interface Drawn {
  of: Record;
  along: number;
  curves: Curve[];
  left: number; // curves that are not drawn
  how: string;
  digits: number;
  isNow(point: Point): boolean;
  take: ((point: Point) => void) | null;
}
/** P95 over the axis, a curve a target, with the limits, and where the design is now. */
function Plot({ of: { axes, points }, along, curves, left, how, digits, isNow, take }: Drawn) {
  const axis = axes[along], xs = [...new Set(axis.values)].sort((a, b) => a - b), shown = curves.flatMap((curve) => curve.points), limits = [...new Set(points.flatMap(({ targets }) => targets.map(({ limit_mm: limit }) => limit)))].filter((limit): limit is number => limit != null);
  const log = xs[0] > 0 && xs.length > 2 && xs[1] - xs[0] < 0.7 * (xs[xs.length - 1] - xs[xs.length - 2]), onX = log ? Math.log : (value: number) => value, ends = [onX(xs[0]), onX(xs[xs.length - 1])];
  const all = [...shown.flatMap(({ y, low, high }) => [y, low, high]), ...limits].filter((value): value is number => value != null), [least, most] = [Math.min(...all), Math.max(...all)], room = 0.08 * (most - least) || 0.1 * most || 1;
  const low = Math.max(0, least - room), high = most + room, x = (value: number) => LEFT + ((RIGHT - LEFT) * (onX(value) - ends[0])) / (ends[1] - ends[0]), y = (value: number) => TALL - ((TALL - TOP) * (value - low)) / (high - low);
  const ticks = log ? decadesOf(xs[0], xs[xs.length - 1]) : ticksOf(xs[0], xs[xs.length - 1], 5), base = axis.base != null && axis.base >= xs[0] && axis.base <= xs[xs.length - 1] ? axis.base : null;
  const names = curves.map(({ name, points: own }) => ({ name, at: y([...own].reverse().find((point) => point.y !== null)?.y ?? low) })).sort((a, b) => a.at - b.at);
  names.forEach((each, k) => k && (each.at = Math.max(each.at, names[k - 1].at + 12))); // words that would lie over one another
  const words = `P95 of the error at the tool, mm, ${how}, over ${nameOf(axis)}${left ? `; the ${curves.length} of ${curves.length + left} with the largest` : ""}${limits.length ? `; limit ${limits.map(brief).join(", ")} mm` : ""}${shown.some(({ of }) => of.verdict === "fail") ? "; a ring is a design that fails" : ""}. ${curves.map(({ name, points: own }) => { const known = own.filter((point) => point.y !== null), last = known[known.length - 1]; return `${name}: ${mm(known[0]?.y, digits)} at ${brief(known[0]?.x)}, ${mm(last?.y, digits)} at ${brief(last?.x)}`; }).join("; ")}.`;
  return (
    <figure class="histogram plot">
      <figcaption>{words}</figcaption>
      <svg viewBox={`0 0 ${WIDE} ${TALL + 34}`} role="img" aria-label={words}>
        {ticksOf(low, high, 5).map((value) => <g key={value} class="tick"><path d={`M${LEFT} ${y(value)}H${RIGHT}`} /><text x={LEFT - 4} y={y(value) + 4} text-anchor="end">{brief(value)}</text></g>)}
        {limits.map((limit) => <g key={limit} class="limit"><path d={`M${LEFT} ${y(limit)}H${RIGHT}`} /><text x={RIGHT + 4} y={y(limit) + 4}>{`limit ${brief(limit)}`}</text></g>)}
        {base !== null && <g class="now"><path d={`M${x(base)} ${TALL}V${TOP}`} /><text x={x(base)} y={TOP - 3} text-anchor="middle">as it was</text></g>}
        {curves.map(({ name, points: own }, c) => (
          <g key={name} class="line">
            <path class="curve" stroke-dasharray={DASHES[c]} d={own.reduce((path, point, k) => (point.y === null ? path : `${path}${k && own[k - 1].y !== null ? "L" : "M"}${x(point.x)} ${y(point.y)}`), "")} />
            {own.map(({ x: at, y: value, low: from, high: to, of }, k) => value !== null && (
              <g key={k} class={[of.verdict === "fail" ? "fails" : "", isNow(of) ? "here" : "", take ? "free" : ""].join(" ")} onClick={() => take?.(of)}>
                <title>{`${name}: P95 ${mm(value, digits)} mm at ${brief(at)} ${axis.unit}, ${VERDICTS[of.verdict ?? ""] ?? of.verdict}${take ? "; press to take it" : ""}`}</title>
                {from != null && to != null && <path d={`M${x(at)} ${y(from)}V${y(to)}`} />}<circle class="reach" cx={x(at)} cy={y(value)} r={8} /><circle cx={x(at)} cy={y(value)} r={isNow(of) ? 5 : 3} />
              </g>
            ))}
          </g>
        ))}
        {names.map(({ name, at }) => !(limits.length && names.length === 1 && Math.abs(at - y(limits[0])) < 12) && <text key={name} class="name" x={RIGHT + 4} y={at + 4}>{name.length > 9 ? `${name.slice(0, 8)}…` : name}<title>{name}</title></text>)}
        <path class="axis" d={`M${LEFT} ${TOP}V${TALL}H${RIGHT}`} />
        {ticks.map((value) => <text key={value} x={x(value)} y={TALL + 14} text-anchor="middle">{brief(value)}</text>)}
        <text x={(LEFT + RIGHT) / 2} y={TALL + 29} text-anchor="middle">{nameOf(axis)}</text><text x={0} y={TOP - 3}>mm</text>
      </svg>
    </figure>
  );
}
