// What a design came to: by estimate and by simulation.  Every number here is of one of the two, and is held against
// numbers of its own kind alone: what would mix them is no program.

import { computed, effect, signal } from "@preact/signals";
import type { components } from "../../../openapi/typescript/tailstack";
import { answer, current, type Score, type TargetScore } from "./api";
import { equal } from "./document";
import { results } from "./jobs";
import { gesture, type Json, position, steps, text } from "./state";
import { decimalsOf, trust } from "./words";

export type Verification = components["schemas"]["Verification"];
export type Check = Score["verdict"]["checks"][number];
export type Joined = NonNullable<Score["measures"]>[number];
interface Records {
  estimate: Score;
  simulation: Verification;
}
export type Kind = keyof Records;
export const BY: Record<Kind, string> = { estimate: "by estimate", simulation: "verified by simulation" };

/** What a record says of what decides. */
export interface Reading<K extends Kind> {
  kind: K;
  apart?: (kind: K) => K; // never there: without it, a reading of one kind would pass for one of either
  record: Records[K];
  sha: string | null | undefined;
  decides: Check | undefined;
  target: Records[K]["targets"][number]; // where it decides; without a requirement, or where that joins several, that with the largest P95
  joined: Joined | undefined; // what decides where that is a measure of several targets, or of another kind than the target's own
  headline: string; // what the value is: P95
  of: string; // of what, and where, in words
  value: number; // of what decides, else P95
  unit: string; // of the value
  digits: number; // decimals of the value
  decimals: number; // of lengths
}
export type AnyReading = Reading<"estimate"> | Reading<"simulation">;

/** All that is known of a design. */
export interface Known {
  estimate: Reading<"estimate"> | null;
  simulation: Reading<"simulation"> | null;
}

const ORDER: Record<string, number> = { fail: 0, inconclusive: 1, pass: 2 };

/** The check that the verdict rests on, as the service's reports have it: the worst status, then the largest value over its limit. */
export function decisive(checks: readonly Check[]): Check | undefined {
  const urgency = (check: Check): [number, number] => [ORDER[check.status] ?? 1, -check.value / check.limit];
  return [...checks].sort((a, b) => urgency(a)[0] - urgency(b)[0] || urgency(a)[1] - urgency(b)[1])[0];
}

const KINDS: Record<string, Kind> = { "tailstack/score/1": "estimate", "tailstack/verification/1": "simulation" };

/** A record says itself of which kind it is. */
export function read<K extends Kind>(record: Records[K] & { schema: Records[K]["schema"] }): Reading<K> {
  const { targets, measures, verdict, provenance } = record as Score, decides = decisive(verdict.checks), unit = decides?.unit ?? "mm";
  const own = targets.find(({ name }) => name === decides?.target), target = own ?? [...targets].sort((a, b) => b.p95_mm - a.p95_mm)[0];
  const joined = measures?.find(({ measure, site }) => measure === decides?.error && site === decides.target);
  return {
    kind: KINDS[record.schema] as K, record, sha: provenance.design_sha256, decides, target: target as Records[K]["targets"][number], joined,
    headline: decides?.headline ?? "P95", of: `of ${decides?.words ?? "the error at the tool"}, ${decides && !own ? decides.target : `target ${target.name}`}`,
    value: decides?.value ?? target.p95_mm, unit, digits: decimalsOf(record as Score, unit), decimals: decimalsOf(record as Score),
  };
}
const ofScore = (score: Score): Reading<"estimate"> => read<"estimate">(score);

export interface Change {
  kind: Kind;
  from: number;
  to: number; // in the unit of what decides, as they are written
  decimals: number; // that show the change
}

/** From one design to the next: null where another requirement decides, or nothing changes that could be read. */
export function compare<K extends Kind>(now: Reading<K>, before: Reading<K>): Change | null {
  const of = ({ decides, target }: { decides?: Check; target: { name: string } }) => JSON.stringify([decides?.requirement, decides?.headline, decides?.target ?? target.name]);
  const decimals = now.digits + 1, [from, to] = [before.value, now.value].map((value) => Number(value.toFixed(decimals)));
  return of(now) === of(before) && from !== to ? { kind: now.kind, from, to, decimals } : null;
}

const bare = ({ optimise, review, ...rest }: Json) => rest;
/** Whether a record is of a design; an optimum on the page is so whatever it says might change: no number rests on that. */
const isOf = ({ provenance, certificate, design }: Json, sha: string) => provenance?.design_sha256 === sha
  || (certificate && design && sha === answer.value?.score.provenance.design_sha256 && equal(bare(design), bare(answer.value!.design)));

/** What a simulation showed of a design, null where the page knows of none; of several, that with the most shots. */
export function simulationOf(sha: string | null | undefined): Reading<"simulation"> | null {
  if (!sha) return null;
  const found = Object.values(results.value).flatMap((record: Json): Verification[] => {
    if (!isOf(record, sha)) return [];
    const own = record.verification ?? record.certificate?.verification ?? record; // a report's, an optimum's, or itself
    return KINDS[own.schema] === "simulation" ? [own] : [];
  });
  const most = found.sort((a, b) => b.trials - a.trials)[0];
  return most ? read<"simulation">(most) : null;
}

const knownOf = (estimate: Reading<"estimate"> | null): Known => ({ estimate, simulation: simulationOf(estimate?.sha) });

// --- the design on the page ---------------------------------------------------------------------------------------------

export const estimated = computed(() => answer.value && ofScore(answer.value.score));
/** The design of the last score. */
export const known = computed<Known>(() => knownOf(estimated.value));
/** What the strip shows: the simulation's numbers where there is one, all of them. */
export const shown = computed<AnyReading | null>(() => known.value.simulation ?? known.value.estimate);
export const verified = computed(() => known.value.simulation);
/** Decimals of the lengths of the score. */
export const decimals = computed(() => estimated.value?.decimals ?? 3);

/** The estimate's check of what decides: by the simulation, where there is one. */
export function answering({ estimate, simulation }: Known): Check | undefined {
  const of = simulation?.decides;
  return of ? estimate?.record.verdict.checks.find(({ requirement, target }) => requirement === of.requirement && target === of.target) : estimate?.decides;
}

/** How far an estimate and a simulation of one design are apart that speak of the same. */
const LOOSE = 0.05; // of what is said to be nearer than this, nobody's budget is another for being off by as much

export interface Standing {
  holds: boolean; // whether budget, slack and advice, which are of the estimate, can be gone by
  words: string;
  off: number | null; // estimate over simulation, less 1
}
/** Whether the estimate of a design can be gone by; a simulation knows better than what is said of such designs. */
export function standingOf({ estimate, simulation }: Known): Standing {
  if (!estimate) return { holds: false, words: "", off: null };
  const { validity } = estimate.record, error = validity.expected_error_percent, unknown = estimate.decides?.interval[1] === null; // what is said of P95 at the tool is said of no other measure
  if (!simulation) return { holds: error !== null, words: trust(unknown && error !== null ? { expected_error_percent: null, calibrated: false } : validity), off: null };
  const found = answering({ estimate, simulation })?.value ?? estimate.record.targets.find(({ name }) => name === simulation.target.name)?.p95_mm ?? estimate.value, off = found / simulation.value - 1;
  const holds = Math.abs(off) <= Math.max(LOOSE, (error ?? 0) / 100) + precisionOf(simulation);
  const side = `${(100 * Math.abs(off)).toFixed(Math.abs(off) < 0.1 ? 1 : 0)} % ${off < 0 ? "below" : "above"} it`;
  return { holds, off, words: holds ? `The estimate is ${side}.` : `The estimate is ${side}: it does not hold here, and nor do the budget and the slack, which are estimates (grey).` };
}
export const standing = computed(() => standingOf(known.value));

/** Relative half-width of the interval of what decides. */
export function precisionOf({ decides, record }: Reading<"simulation">): number {
  const [low, high] = decides?.interval ?? [null, null];
  return decides && low != null && high != null && decides.value > 0 ? (high - low) / 2 / decides.value : record.precision_reached;
}

// --- what a change has come to ------------------------------------------------------------------------------------------

/** What states of the design came to, by their text; the newest. */
export const seen = signal<ReadonlyMap<string, Reading<"estimate">>>(new Map());
const MOST_SEEN = 100;
effect(() => {
  if (!current.value || !answer.value || gesture.value.length) return;
  const all = new Map(seen.peek()), source = text.value;
  all.delete(source);
  all.set(source, ofScore(answer.value.score));
  for (const old of [...all.keys()].slice(0, -MOST_SEEN)) all.delete(old);
  seen.value = all;
});
export const seenOf = (source: string): Known => knownOf(seen.value.get(source) ?? null);

/** The state that the present one is compared with: that at the grab while something is dragged, then the step before. */
export const before = computed<Known>(() => {
  const source = gesture.value.length ? text.value : steps.value[position.value]?.opens ? undefined : steps.value[position.value - 1]?.text;
  return source === undefined ? { estimate: null, simulation: null } : seenOf(source);
});

/** By how much two designs differ, estimate from estimate, and simulation from simulation with the same random numbers. */
export const changes = (now: Known, then: Known): Record<Kind, Change | null> => ({
  estimate: now.estimate && then.estimate && compare(now.estimate, then.estimate),
  simulation: now.simulation && then.simulation && now.simulation.record.seed === then.simulation.record.seed ? compare(now.simulation, then.simulation) : null,
});
/** By how much the number in the strip has changed. */
export const change = computed(() => (shown.value ? changes(known.value, before.value)[shown.value.kind] : null));

/** What a line of the budget moves the target by, mm: root mean square; it falls only where the line itself falls. */
export const spread = (target: TargetScore, share: number): number => Math.sqrt(share * [0, 1, 2].reduce((sum, k) => sum + target.covariance_mm2[k][k], 0));
