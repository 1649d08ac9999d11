// Where a bead would be better, drawn in the pictures: an arrow along which what decides falls, the colour of what losing
// it costs, and round the bead that is held or chosen contours of what decides, red where the design would be refused.

import { computed, effect, signal } from "@preact/signals";
import { useEffect, useState } from "preact/hooks";
import { mayBound, worthy } from "../best";
import { answer, askWhenQuiet, current, layout, refused, type Score, send, targetNames } from "../api";
import { add, contour, length, type Pixel, type Projection, project, roundStep, type Vector } from "../geometry";
import { type Check, estimated } from "../readings";
import { design, gesture, type Json, recall, remember, withEdits } from "../state";
import { brief, decimalsOf } from "../words";
import { type Bead, beads, type Box, type Plane } from "./Pictures";

const SWITCHES = { arrows: "Where to drop", losing: "Cost of losing", contours: "Contours", best: "Where beads tell most" }, KEY = "tailstack.workbench.places";
const hidden = signal<(keyof typeof SWITCHES)[]>(recall(KEY, ["best"]));
effect(() => void remember(KEY, hidden.value));
export const shows = (what: keyof typeof SWITCHES) => !hidden.value.includes(what);

export const PlaceSwitches = () => (Object.keys(SWITCHES) as (keyof typeof SWITCHES)[]).filter((what) => what !== "best" || mayBound.value).map((what) => (
  <button type="button" key={what} class="small" aria-pressed={shows(what)} onClick={() => (hidden.value = shows(what) ? [...hidden.value, what] : hidden.value.filter((each) => each !== what))}>{SWITCHES[what]}</button>
));

const MOST_TARGETS = 40, MOST_BEADS = 40; // beyond, what is asked for here takes the service long
const light = computed(() => targetNames.value.length <= MOST_TARGETS && beads.value.length <= MOST_BEADS);

// --- what each bead is worth -----------------------------------------------------------------------------------------

type Worth = NonNullable<Score["fiducials"]>[number];
const weighed = signal<{ design: Json; of: Map<string, Worth> } | null>(null);
/** By label, of the design on the page. */
const worth = computed(() => (weighed.value?.design === design.value && current.value ? weighed.value!.of : null));
const QUIET = 600; // ms without a change, after which it is asked for

effect(() => {
  const asked = design.value;
  if (!current.value || gesture.value.length || !light.value || !(shows("arrows") || shows("losing")) || weighed.peek()?.design === asked) return;
  return askWhenQuiet(QUIET, async (left) => {
    const response = await send("POST", "/v1/scores", { design: asked, losses: false, fiducials: true }, {}, left).catch(() => null);
    if (response?.ok) weighed.value = { design: asked, of: new Map(((await response.json()) as Score).fiducials?.map((each) => [each.fiducial, each])) };
  });
});

const steepest = computed(() => Math.max(0, ...[...(worth.value?.values() ?? [])].map(({ slope }) => (slope ? length(slope) : 0))));
const costs = computed(() => new Map([...(worth.value ?? [])].map(([label, { value_without: without }]) => [label, without === null ? Infinity : without - estimated.value!.value])));
const dearest = computed(() => Math.max(0, ...[...costs.value.values()].filter(Number.isFinite)));
const signed = (value: number) => `${value < 0 ? "−" : "+"}${brief(Math.abs(value))}`;

/** What a bead is worth, in words; empty where nothing is known. */
export function worthOf(label: string): string {
  const own = worth.value?.get(label), { unit } = estimated.value ?? { unit: "" };
  if (!own) return "";
  const moving = own.slope && length(own.slope) > 0 ? `; along its arrow ${signed(-length(own.slope))} ${unit} per mm` : "";
  return `${moving}; without it ${own.value_without === null ? "no answer" : `${own.value_without.toFixed(decimalsOf(answer.value!.score, unit) + 1)} ${unit} (${signed(costs.value.get(label)!)})`}`;
}

/** How much losing a bead costs, of what losing the dearest does; null where it is not shown. */
export const heatOf = (label: string): number | null => (shows("losing") && costs.value.has(label) && dearest.value > 0 ? Math.min(1, Math.max(0, costs.value.get(label)! / dearest.value)) : null);

const LONGEST = 40, SHORTEST = 3, PROBE_MM = 1e-3; // of arrows, in pixels of the screen

/** An arrow for each bead: of one length for all that are as steep, where they lie across the beam. */
export function Arrows({ plane, scale }: { plane: Plane; scale: number }) {
  if (!worth.value || !shows("arrows") || !steepest.value) return null;
  return (
    <g class="arrows" aria-hidden="true">
      {beads.value.map(({ label, position }) => {
        const slope = worth.value!.get(label)?.slope, at = plane.to(position);
        if (!slope || !at) return null;
        const shift = (way: Vector) => { const moved = plane.to(add(position, way, PROBE_MM))!; return [(moved[0] - at[0]) / PROBE_MM, (moved[1] - at[1]) / PROBE_MM]; };
        const per = Math.max(...[[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis) => Math.hypot(...shift(axis as Vector)))); // units of the picture in a mm
        const [x, y] = shift(slope.map((v) => -v / steepest.value) as Vector).map((v) => (v * LONGEST * scale) / per), size = Math.hypot(x, y);
        if (size < SHORTEST * scale) return null;
        const [p, q] = [at[0] + x, at[1] + y], head = Math.min(6 * scale, 0.5 * size) / size;
        return <path key={label} data-arrow={label} d={`M${at[0]} ${at[1]}L${p} ${q}M${p - head * (x + 0.5 * y)} ${q - head * (y - 0.5 * x)}L${p} ${q}L${p - head * (x - 0.5 * y)} ${q - head * (y + 0.5 * x)}`} />;
      })}
    </g>
  );
}

/** A disc where the best layouts have beads, the larger the more of them do. */
export const Worthy = ({ plane, scale }: { plane: Plane; scale: number }) => !shows("best") ? null : (
  <g class="worthy" aria-hidden="true">
    {worthy.value.map(({ position_mm: place, fiducials: many }) => {
      const at = plane.to(place);
      return at && <circle key={place.join()} cx={at[0]} cy={at[1]} r={(2 + 9 * Math.sqrt(many)) * scale}><title>{`the best mixture of layouts has ${brief(many)} beads here`}</title></circle>;
    })}
  </g>
);

/** What arrows and colours stand for; while they are found, its place. */
export function PlaceLegend() {
  if (!light.value || !(shows("arrows") || shows("losing")) || refused.value) return null;
  const reading = estimated.value, why = [...(worth.value?.values() ?? [])].find((each) => each.why && !each.slope)?.why, [dear] = [...costs.value].sort((a, b) => b[1] - a[1]);
  return (
    <p class="note places steady" data-kind="estimate">
      {!worth.value || !reading ? "\u00a0" : [
        shows("arrows") && (why ? `No arrows: ${why}.` : `Arrows: where ${reading.headline} falls, the longest by ${brief(steepest.value)} ${reading.unit} for each mm.`),
        shows("losing") && dear && `Colour: what losing the bead costs, most of all ${dear[0]}, ${Number.isFinite(dear[1]) ? `${signed(dear[1])} ${reading.unit}` : "without which there is no answer"}.`,
      ].filter(Boolean).join(" ")}
    </p>
  );
}

// --- contours round a bead -------------------------------------------------------------------------------------------

/** What decides, at places of a picture round a bead: rows of ``size`` from its left upper corner. */
interface Patch {
  key: string; // of all that it depends on, beside where in the picture the bead is
  at: Pixel; // its middle
  corner: Pixel;
  step: number; // of its places, in units of the picture
  size: number;
  values: (number | null)[];
  whys: string[]; // why a place is none; empty: it may be one
  fine: boolean;
}
const COARSE = 7, FINE = 33, QUICK = 300, REST = 150, REACH = 0.28, INNER = 0.5; // places a side; ms; parts of the picture and of the patch

/** The design with nothing to judge but what decides, where that is: the service judges every row by all there is. */
function decidingAlone(data: Json, decides: Check | undefined): Json {
  const { optimise, review, assumed, ...rest } = data, all: Json[] = decides ? data.requirements : [], own = all.length === 1 ? all[0] : all.find(({ name }) => name === decides?.requirement);
  const entry = data.targets?.find((each: Json) => each?.name === decides?.target.replace(/\[\d+\]$/, "")); // a sample of a region has its name; what joins several has none
  return { ...rest, requirements: own ? [{ ...own, ...(entry && { targets: [entry.name] }) }] : [] };
}

/** The patch round a bead that is held or chosen in this picture, once it rests; it is asked for again where it leaves
 * that, or anything else changes. */
export function usePatch(plane: Plane, bead: Bead | undefined, box: Box, watched: boolean): Patch | null {
  const [patch, keep] = useState<Patch | null>(null), at = bead && plane.to(bead.position), reading = estimated.value;
  const path = bead && ["fiducials", "points", bead.index, "position_mm"], wanted = watched && shows("contours") && light.value && bead && at && reading && reading.decides?.min_yield == null; // of each unit a place takes a sample of units
  const key = wanted ? JSON.stringify([plane.name, reading.decides?.requirement, plane.from(bead.position, [0, 0]).map((v) => v.toFixed(3)), withEdits(design.value, [{ path: path!, value: null }])]) : "";
  const own = patch && patch.key === key ? patch : null, near = own && at && Math.max(...[0, 1].map((k) => Math.abs(at[k] - own.at[k]))) < INNER * REACH * box[2];
  const rests = Boolean(near && own.fine);
  useEffect(() => {
    if (!wanted || rests) return;
    const ask = async (size: number, left: AbortSignal): Promise<boolean> => {
      const side = 2 * REACH * box[2], step = side / (size - 1), corner: Pixel = [at[0] - side / 2, at[1] - side / 2];
      const points = Array.from({ length: size * size }, (_, k) => plane.from(bead.position, [corner[0] + step * (k % size), corner[1] + step * Math.floor(k / size)]));
      const table = Object.fromEntries([0, 1, 2].map((k) => [`/${path!.join("/")}/${k}`, points.map((p) => p[k])])), begin = performance.now();
      const response = await send("POST", "/v1/scores/batch", { design: decidingAlone(design.value, reading.decides), table, columns: [reading.decides ? "value" : "p95_mm"] }, {}, left).catch(() => null);
      if (!response?.ok) return false;
      const { columns } = (await response.json()) as { columns: Record<string, Json[]> };
      const name = reading.decides ? `value:${reading.decides.requirement}:${reading.decides.target}` : `p95_mm:${reading.target.name}`;
      if (left.aborted) return false;
      keep({ key, at, corner, step, size, values: columns[name], whys: points.map((p, k) => columns.reason[k] || overlapOf(bead, p)), fine: size === FINE });
      return performance.now() - begin <= QUICK;
    };
    return askWhenQuiet(REST, async (left) => {
      const quick = (await ask(COARSE, left)) || (await ask(COARSE, left)); // the first may have waited until the service was warm
      if (quick) await ask(FINE, left);
      else if (!left.aborted) keep((own) => own && { ...own, fine: true });
    });
  }, [key, rests, rests ? "" : String(at)]);
  return own;
}

/** In which image a bead at a place would lie over another, nearer than the service says that they are told apart. */
function overlapOf(bead: Bead, place: Vector): string {
  for (const view of layout.value?.views ?? []) {
    const P = view.projection as Projection, at = project(P, place), needs = answer.value?.score.views.find((each) => each.view === view.view)?.closest_pair_needs_px ?? 0;
    const over = at && beads.value.find((other) => { const p = other.label !== bead.label && project(P, other.position); return p && Math.hypot(p[0] - at[0], p[1] - at[1]) < needs; });
    if (over) return `over ${over.label} in ${view.view}`;
  }
  return "";
}

const LEVELS = 7, MOST = 0.9; // contours, up to what part of the places lies below

export function Contours({ patch, scale }: { patch: Patch; scale: number }) {
  const { corner: [x, y], step, size, values, whys } = patch, reading = estimated.value!, known = values.filter((v): v is number => v !== null).sort((a, b) => a - b);
  const place = ([i, j]: Pixel): Pixel => [x + step * i, y + step * j], low = known[0], high = known[Math.floor(MOST * (known.length - 1))], every = known.length > 1 && high > low ? roundStep((1.5 * (high - low)) / LEVELS) : 0;
  const digits = every ? Math.max(0, -Math.floor(Math.log10(every) + 1e-9)) : 0, limit = reading.decides?.limit;
  const levels = every ? Array.from({ length: Math.floor((high - low) / every) + 1 }, (_, k) => Number(((Math.ceil(low / every) + k) * every).toFixed(digits))) : [];
  const lines = [...levels, ...(limit !== undefined && limit > low && !levels.includes(limit) ? [limit] : [])].map((level) => ({ level, parts: contour(values, size, level) })).filter(({ parts }) => parts.length);
  const least = values.indexOf(low), best = low === undefined ? null : place([least % size, Math.floor(least / size)]);
  return (
    <g class={patch.fine ? "contours" : "contours coarse"} data-kind="estimate">
      {whys.map((why, k) => why && <rect key={k} class="refusal" x={x + step * ((k % size) - 0.5)} y={y + step * (Math.floor(k / size) - 0.5)} width={step} height={step}><title>{why}</title></rect>)}
      {lines.map(({ level, parts }) => {
        const [p, q] = place(parts[Math.floor(parts.length / 2)][0]);
        return (
          <g key={level} class={level === limit ? "level limit" : "level"} data-level={level}>
            <path d={parts.map(([a, b]) => `M${place(a).join(" ")}L${place(b).join(" ")}`).join("")} />
            <text x={p} y={q + 3 * scale} font-size={10 * scale} text-anchor="middle">{level.toFixed(digits)}</text>
          </g>
        );
      })}
      {best && <path class="least" d={`M${best[0] - 4 * scale} ${best[1]}h${8 * scale}M${best[0]} ${best[1] - 4 * scale}v${8 * scale}`}><title>{`least of these places: ${low.toFixed(digits + 1)} ${reading.unit}`}</title></path>}
    </g>
  );
}
