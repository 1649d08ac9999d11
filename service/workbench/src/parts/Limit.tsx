// The limit, and what the design comes to, as handles: while one is dragged, the cheapest half-widths that keep it move
// with the hand.  One request in flight, the latest place of the hand wins, and a finished drag is one step.

import { computed, effect, signal, untracked } from "@preact/signals";
import { useRef } from "preact/hooks";
import type { components } from "../../../../openapi/typescript/tailstack";
import { advised, placeOf, seatsOf } from "../advice";
import { askWhenQuiet, current, late, readRefusal, refused, send, unreachable } from "../api";
import { SEATS } from "../document";
import { answering, type Check, decisive, estimated, known, standing } from "../readings";
import { cancelGesture, design, type Edit, edit, gesture, type Json, opened, type Path, PRESSES, preview, settled } from "../state";
import { brief, mm, sign, stated } from "../words";
import { grip, stepsOf } from "./grip";

type Allocation = components["schemas"]["Allocation"];
type Handle = "limit" | "value";

const QUIET = 500; // ms without a change, after which the least cost is looked for
const FLOOR = 1e-4; // relative: what is aimed at stays so far above what is out of reach
const NEAR = 1.002; // so near to the least that there is, it is told
const SNAP = 6; // px within which what it comes to is dragged onto the limit

// --- what may change ---------------------------------------------------------------------------------------------------

const ROTATIONS = ["rx", "ry", "rz"], TRANSLATIONS = ["tx", "ty", "tz"], FREE = ["tolerances", "rotation_bounds", "translation_bounds"];

/** The design with what an allocation may change: as it says; where it does not, each seat from a tenth to three times. */
const withFree = (data: Json): Json => (FREE.some((field) => data?.optimise?.[field]) ? data : { ...data, optimise: { ...data?.optimise, tolerances: seatsOf(data, 0.1, 3) } });

/** CONTRIBUTOR.COMPONENT of a half-width of a seat; null of any other. */
export function seatOf(data: Json, path: Path): string | null {
  const [part, seat, field, component] = path;
  return part !== "interfaces" ? null : field === "tolerances" ? `${seat}.${component}` : field === "locators" ? `${seat}.${data?.interfaces?.[seat]?.locators?.[component]?.name}` : null;
}

const free = computed(() => {
  const { tolerances = [], rotation_bounds: turns, translation_bounds: shifts } = withFree(settled.value)?.optimise ?? {}, names = [...(turns ? ROTATIONS : []), ...(shifts ? TRANSLATIONS : [])];
  const listed: string[] = (Array.isArray(tolerances) ? tolerances : []).filter((each) => !each?.grades).map((each) => `${each?.interface}.${each?.component}`);
  return new Set([...listed, ...SEATS.flatMap((seat) => names.map((name) => `${seat}.${name}`))]);
});

const locked = signal<ReadonlySet<string>>(new Set());
/** Why nothing can be dragged, where that is seen without asking. */
export const barred = computed(() => {
  if ([settled.value?.optimise?.tolerances ?? []].flat().some((each: Json) => each?.grades)) return "Half-widths are bought from tables of grades here: nothing in between to drag; Optimise chooses among them.";
  if ([...free.value].every((name) => locked.value.has(name))) return free.value.size ? "Every half-width that is free is locked: open a padlock." : "No half-width of a seat is free: there is nothing to drag.";
  return standing.value.holds || !standing.value.words ? "" : "The estimate does not hold here: nothing to drag by.";
});
effect(() => {
  if (opened.value) locked.value = new Set();
});

/** A padlock for a half-width that the dragged limit may move. */
export function Lock({ path, label }: { path: Path; label: string }) {
  const name = seatOf(settled.value, path), shut = name !== null && locked.value.has(name);
  if (name === null || !free.value.has(name)) return free.value.size > 0 ? <span class="lock" /> : null;
  const turn = () => (locked.value = new Set(shut ? [...locked.value].filter((each) => each !== name) : [...locked.value, name]));
  return (
    <button type="button" class="lock" aria-pressed={shut} aria-label={`Lock ${label}`} title={shut ? "stays as it is while the limit is dragged; press to free it" : "lock it: it stays as it is while the limit is dragged"} onClick={turn}>
      <svg viewBox="0 0 12 14" aria-hidden="true"><path d={shut ? "M3 7V4a3 3 0 0 1 6 0v3" : "M3 7V4a3 3 0 0 1 6 0"} /><rect x="1" y="7" width="10" height="6.5" rx="1" /></svg>
    </button>
  );
}

// --- what is asked -----------------------------------------------------------------------------------------------------

/** Where the limit of a requirement stands in the design. */
export function limitOf(data: Json, requirement: string): Path | null {
  const all: Json[] = Array.isArray(data?.requirements) ? data.requirements : [], k = all.length === 1 ? 0 : all.findIndex((each) => each?.name === requirement);
  const field = Object.keys(all[k] ?? {}).find((name) => name.startsWith("limit_") && name !== "limit_probability");
  return field && typeof all[k][field] === "number" ? ["requirements", k, field] : null;
}

interface Answer {
  found: Allocation | null;
  problem: string; // why there is none
}
async function ask(data: Json, requirement: string, aim: number, stays: ReadonlySet<string>, stop?: AbortSignal): Promise<Answer> {
  const response = await send("POST", "/v1/allocations", { design: withFree(data), requirement, limit: aim, locked: [...stays].filter((name) => free.value.has(name)) }, {}, stop).catch(() => null);
  if (response?.ok) return { found: await response.json(), problem: "" };
  const { title, errors: [{ detail, hint }] } = response ? await readRefusal(response) : unreachable();
  return { found: null, problem: response ? [detail, hint].filter(Boolean).join("; ") : `${title}: nothing was changed.` };
}

interface Drag {
  of: Handle;
  base: Json; // the design at the grab
  requirement: string;
  limit: Path | null;
  share: number; // of a limit, that is aimed at
  end: number; // of the scale
  step: number; // to which what the hand says is rounded
  least: number; // that can be reached, 0 where it is not known yet
  at: number; // where the hand is, in the unit of the requirement
  heard: number; // of which place of the hand the half-widths on the page are
  done: { what: string; within: number } | null; // it was let go
  stated: boolean; // the limit, which is kept, or refused, and never another
}
const drag = signal<Drag | null>(null);
export const pulling = computed(() => drag.value !== null);

/** The check that the handles are of, by estimate: of what is dragged, else of what decides among what has a size. */
const judged = computed(() => {
  const first = answering(known.value), of = drag.value?.requirement, sized = (known.value.estimate?.record.verdict.checks ?? []).filter(({ unit, requirement }) => unit !== "of 1" && (of === undefined || requirement === of));
  return of === undefined && first && sized.includes(first) ? first : decisive(sized);
});
/** What is aimed at so that the estimate passes with what it may be off by, as far as that can be reached. */
export const passing = ({ value, interval: [, high] }: Check) => (high !== null && value > 0 ? value / high : 1);
const aimFor = (limit: number, share: number, least: number) => Math.min(limit, Math.max(limit * share * (1 - FLOOR), least * (1 + FLOOR)));
/** What a hand can mean: of a limit of 1 to 10, hundredths. */
export const stepFor = ({ limit }: Check) => 10 ** (Math.floor(Math.log10(limit)) - 2);
export const round = (value: number, step: number, way = Math.round) => Number((Math.max(1, way(value / step)) * step).toPrecision(12));

/** At rest: the least cost of keeping the limit, and how low it can be, before anybody pulls. */
const rest = signal<(Answer & { design: Json; stays: ReadonlySet<string> }) | null>(null);
const rested = computed(() => (rest.value && rest.value.design === settled.value && rest.value.stays === locked.value ? rest.value : null));
effect(() => {
  const data = design.value, check = judged.value, stays = locked.value;
  if (!check || !current.value || refused.value || gesture.value.length || barred.value || !standing.value.holds || rested.value) return;
  return askWhenQuiet(QUIET, async (left) => {
    const first = await ask(data, check.requirement, check.limit * passing(check), stays, left);
    const again = first.found?.status === "out of reach" && first.found.least < check.limit ? await ask(data, check.requirement, aimFor(check.limit, passing(check), first.found.least), stays, left) : first;
    if (!left.aborted) rest.value = { ...again, design: data, stays };
  });
});

// --- the drag ----------------------------------------------------------------------------------------------------------

const moved = signal<Answer & { design: Json }>({ found: null, problem: "", design: null }); // of the last drag; the design that it led to
let flying = false;

const scaleFor = ({ value, limit }: Check) => 1.35 * Math.max(value, limit);
const lowest = (least: number, step: number) => (least > 0 ? round(least * (1 + 2 * FLOOR), step / 10, Math.ceil) : 0);

function grab(of: Handle): boolean {
  const check = judged.value;
  if (!check || barred.value || !standing.value.holds || refused.value || (gesture.value.length && !drag.value)) return false;
  if (drag.value && drag.value.base === settled.value && !drag.value.done) return true;
  const limit = limitOf(settled.value, check.requirement);
  if (of === "limit" && !limit) return false;
  drag.value = { of, base: settled.value, requirement: check.requirement, limit, share: passing(check), end: scaleFor(check), step: stepFor(check), least: rested.value?.found?.least ?? 0, at: check[of], heard: NaN, done: null, stated: false };
  return true;
}

/** ``exactly``: it was typed, or is where an edge is. */
function pull(at: number, exactly = false): void {
  const now = drag.value;
  if (!now) return;
  drag.value = { ...now, at: Math.max(exactly ? at : round(at, now.step), lowest(now.least, now.step)) };
  void follow();
}

function release(what: string, within = 0): void {
  if (!drag.value) return;
  drag.value = { ...drag.value, done: { what, within } };
  void follow();
}

function drop(problem = ""): void {
  drag.value = null;
  if (problem) moved.value = { found: null, problem, design: settled.value };
  cancelGesture();
}

const asks = ({ of, at, share, least }: Drag) => (of === "limit" ? aimFor(at, share, least) : at);

async function follow(): Promise<void> {
  if (flying) return;
  flying = true;
  try {
    for (let now = drag.value; now && now.at !== now.heard; now = drag.value) {
      if (now.base !== settled.value) return drop();
      const { found, problem } = await ask(now.base, now.requirement, asks(now), locked.value), latest = drag.value;
      if (!latest || latest.base !== now.base) continue; // let go of meanwhile, or another drag
      if (settled.value !== now.base) return drop();
      if (!found) return drop(problem);
      const known = latest.least > 0, least = found.least;
      if (found.status === "out of reach") {
        if (known || least <= asks(now) || (now.stated && least * (1 + FLOOR) > now.at)) return drop(wall(found));
        drag.value = { ...latest, least };
        pull(latest.at, true); // to the least that there is
        continue;
      }
      drag.value = { ...latest, least, heard: now.at };
      moved.value = { found, problem: "", design: null };
      preview(editsOf(now, found));
    }
  } finally {
    flying = false;
  }
  const last = drag.value;
  if (!last?.done) return;
  const edits = gesture.value;
  drag.value = null;
  if (edits.length) edit([...edits], last.done.what, last.done.within);
  moved.value = { ...moved.value, design: settled.value };
}

/** The new half-widths, and the limit where that is what was moved. */
const editsOf = ({ of, at, base, limit }: Drag, { tolerances }: Allocation): Edit[] => [
  ...(of === "limit" ? [{ path: limit!, value: at }] : []),
  ...tolerances.flatMap(({ contributor: name, component, unit, before_half_width: width, after_half_width: value }) => {
    const path = placeOf(base, { name, component, unit, half_width: width });
    return path ? [{ path, value: Number(value.toPrecision(6)) }] : [];
  }),
];

const holder = ({ held_by: by, held_label: label, held_share: share }: Allocation) => `${label || by.replace(/_/g, " ")} has ${(100 * share).toFixed(0)} % of what is left`;
const wall = (found: Allocation) => `Out of reach at this layout: not below ${brief(Number(found.least.toPrecision(3)))}${sign(found.unit)} with every free half-width at its least; ${holder(found)}.`;

/** From what to what; one number where it is as good as that already. */
const costs = ({ cost_before: before, cost_after: after }: Allocation) => (before === null || Math.abs(before - after) < (NEAR - 1) * after ? brief(after) : `${brief(before)} → ${brief(after)}`);

/** What the last answer says. */
function wordsOf({ found, problem }: Answer, d: number, told: boolean): string {
  if (!found) return problem;
  if (found.status === "out of reach") return wall(found);
  const least = `not below ${mm(found.least, d + 1)}${sign(found.unit)}, as ${holder(found)}`;
  const cost = `Cost ${costs(found)}`;
  return told ? `${cost}${found.moved_most ? `; counted at the tool, ${found.moved_most} moves most` : ""}${found.value <= NEAR * found.least ? `; ${least}` : ""}.` : `At this layout ${least}.`;
}

const waits = computed(() => drag.value !== null && (drag.value.at !== drag.value.heard || drag.value.done !== null));
/** What the hand found, as long as it holds or its design is on the page. */
const told = computed(() => (drag.value || moved.value.design === settled.value ? moved.value : null));

// --- the handles -------------------------------------------------------------------------------------------------------

const usable = computed(() => standing.value.holds && !barred.value && !refused.value);

/** A scale with what the design comes to and its limit, both to drag; why not, where neither can be. */
export function Limit() {
  const rail = useRef<HTMLDivElement>(null), check = judged.value, now = drag.value;
  if (!check) return null;
  const { unit, requirement } = check, d = estimated.value!.digits, end = now?.end ?? scaleFor(check), holds = usable.value, path = limitOf(settled.value, requirement);
  const least = now ? now.least : rested.value?.found?.least ?? 0, place = (value: number) => `${(100 * Math.min(1, value / end)).toFixed(2)}%`;
  const where = { limit: now?.of === "limit" ? now.at : check.limit, value: now?.of === "value" ? now.at : check.value };
  const finish = (of: Handle, keys = false) => release(keys ? `${of === "limit" ? "Limit" : check.headline} of ${requirement} by keys, cheapest half-widths` : `${of === "limit" ? "Limit" : check.headline} of ${requirement} to ${drag.value?.at}${sign(unit)}, cheapest half-widths`, keys ? PRESSES : 0);
  const handle = (of: Handle, words: string) => {
    const value = where[of], free = holds && (of === "value" || path !== null);
    return (
      <span class={`handle ${of}`} role="slider" tabIndex={free ? 0 : -1} aria-disabled={!free} aria-label={words} aria-valuemin={Number((least || 0).toPrecision(4))} aria-valuemax={Math.max(end, value)} aria-valuenow={Number(value.toPrecision(6))} aria-valuetext={`${stated(Number(value.toFixed(d + 1)), d)}${sign(unit)}`}
        style={{ left: place(value) }} title={`${words}: drag it, or press an arrow key; the cheapest half-widths follow`}
        {...grip({
          track: () => rail.current!.getBoundingClientRect(), begin: () => free && grab(of), end: () => finish(of), drop,
          to: (part, wide) => {
            if (!drag.value && !grab(of)) return;
            const { end, share, least } = drag.value!, at = Math.max(part, 1 / wide) * end, goal = of === "value" ? aimFor(check.limit, share, least) : NaN, onEdge = Math.abs(at - goal) * wide < SNAP * end;
            pull(onEdge ? goal : at, onEdge);
          },
        })}
        onKeyDown={(event) => {
          if (event.key === "Escape") return drop();
          const by = stepsOf(event), to = { Home: least || value / 100, End: 1.35 * value }[event.key], step = stepFor(check);
          if (!free || (by === null && to === undefined)) return;
          event.preventDefault();
          const begun = drag.value?.at ?? value;
          if (!grab(of)) return;
          pull(to ?? round(begun + by! * step, step * Math.min(1, Math.abs(by!))), true);
          finish(of, true);
        }} />
    );
  };
  return (
    <div class={`rail ${holds ? "" : "outdated"}`} role="group" aria-label="Drag the limit" data-kind="estimate" data-waits={String(waits.value)}>
      <div class="ruler" ref={rail}>
        <span class="line" />{least > 0 && <span class="beyond" style={{ width: place(least) }} title={rested.value ? wordsOf(rested.value, d, false) : `not below ${mm(least, d + 1)}${sign(unit)} at this layout`} />}
        {handle("value", `${check.headline} of ${requirement}`)}{path && handle("limit", `Limit of ${requirement}`)}
      </div>
      {barred.value && <Pulled />}
    </div>
  );
}

/** The limit as it is, kept at one press. */
export function Keep() {
  const check = judged.value, offer = rested.value?.found?.status === "kept" ? rested.value.found : null;
  if (!check) return null;
  const { requirement, limit, unit } = check;
  const keep = () => {
    if (!grab(limitOf(settled.value, requirement) ? "limit" : "value")) return;
    drag.value = { ...drag.value!, least: 0, stated: true };
    pull(limit, true);
    release(`Keep ${requirement} within ${limit}${sign(unit)} by the cheapest half-widths`);
  };
  return <button type="button" class="keep" disabled={!usable.value || drag.value !== null} title="the cheapest half-widths that keep the limit at this layout; locked ones stay. The cost, to compare by: prices under optimise, otherwise 1 / half-width (mm, rad)" onClick={keep}>{`Keep it at least cost${offer ? `: ${costs(offer)}` : ""}`}</button>;
}

/** What the hand found, or why it finds nothing; how low the limit could be is only for those who ask, or cannot see. */
export function Pulled() {
  if (!judged.value) return null;
  const now = told.value, at = rested.value, d = estimated.value!.digits, words = barred.value || (now ? wordsOf(now, d, true) : at ? wordsOf(at, d, false) : "");
  const shown = barred.value || now || (at && at.found?.status !== "kept" && !advised.value?.wall);
  return <p class={`${shown ? "note" : "hidden"} ${waits.value || late.value ? "old" : ""} ${now?.problem ? "bad" : ""}`} data-kind="estimate" data-testid="pulled" role="status">{words}</p>;
}

// Another text under the hand, or a service that is away, ends a drag: what it showed is of nothing that is there
effect(() => {
  const now = drag.value;
  if (now && settled.value !== now.base) untracked(() => drop());
});
