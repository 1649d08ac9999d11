// Which requirement decides, and whether a simulation has judged the design on the page.

import { computed, effect, signal } from "@preact/signals";
import { answer, current, type Score } from "./api";
import { results } from "./jobs";
import { gesture, type Json, position, steps, text } from "./state";
import { decimalsOf } from "./words";

export type Check = Score["verdict"]["checks"][number];

const ORDER: Record<string, number> = { fail: 0, inconclusive: 1, pass: 2 };

/** The check that the verdict rests on, as the service's reports have it: the worst status, then the largest value over its limit. */
export function decisive(checks: readonly Check[]): Check | undefined {
  const urgency = (check: Check): [number, number] => [ORDER[check.status] ?? 1, -check.value_mm / check.limit_mm];
  return [...checks].sort((a, b) => urgency(a)[0] - urgency(b)[0] || urgency(a)[1] - urgency(b)[1])[0];
}

/** The verification of the design that the last score is of; null where the page knows of none. */
export const verified = computed<Json>(() => verificationOf(answer.value?.score.provenance.design_sha256));

/** The verification of a design with the most shots, null where the page knows of none. */
export function verificationOf(sha: string | null | undefined): Json {
  if (!sha) return null;
  const found = Object.values(results.value).flatMap((record) => {
    if (record.provenance?.design_sha256 !== sha) return [];
    const own = record.verification ?? record.certificate?.verification ?? record; // a report's, an optimum's, or itself
    return own.trials && own.verdict ? [own] : [];
  });
  return found.sort((a, b) => b.trials - a.trials)[0] ?? null;
}

/** Decimals of the lengths of the score. */
export const decimals = computed(() => (answer.value ? decimalsOf(answer.value.score) : 3));

// --- what a change has come to ------------------------------------------------------------------------------------------

export interface Seen {
  of: string; // requirement and target
  value: number; // mm, of what decides; without a requirement the P95 of the first target
  shares: Record<string, number>; // of variance, by target, contributor and component
}
export const shareKey = (target: string, contributor: string, component: string) => JSON.stringify([target, contributor, component]);

/** The estimate of a score that the strip shows. */
function seenOf(score: Score): Seen {
  const worst = decisive(score.verdict.checks), first = score.targets[0], shares: Seen["shares"] = {};
  for (const target of score.targets.slice(0, 8)) for (const c of target.contributors.slice(0, 80)) shares[shareKey(target.name, c.name, c.component)] = c.variance_share;
  return { of: JSON.stringify([worst?.requirement, worst?.target ?? first.name]), value: worst?.value_mm ?? first.p95_mm, shares };
}

/** What states of the design came to, by their text; the newest. */
export const seen = signal<ReadonlyMap<string, Seen>>(new Map());
const MOST_SEEN = 100;
effect(() => {
  if (!current.value || !answer.value || gesture.value.length) return;
  const known = new Map(seen.peek()), source = text.peek();
  known.delete(source);
  known.set(source, seenOf(answer.value.score));
  for (const old of [...known.keys()].slice(0, -MOST_SEEN)) known.delete(old);
  seen.value = known;
});

/** The state that the present one is compared with: that at the grab while something is dragged, then the step before. */
export const before = computed<Seen | null>(() => {
  const source = gesture.value.length ? text.value : steps.value[position.value - 1]?.text;
  return (source !== undefined && seen.value.get(source)) || null;
});

/** By how much the number in the strip has changed; null where another requirement decides, or nothing is known. */
export const change = computed<{ from: number; by: number } | null>(() => {
  if (!answer.value || !before.value || verified.value) return null;
  const now = seenOf(answer.value.score);
  return now.of === before.value.of && Math.abs(now.value - before.value.value) >= 0.5 * 0.1 ** (decimals.value + 1) ? { from: before.value.value, by: now.value - before.value.value } : null;
});
