// Which requirement decides, and whether a simulation has judged the design on the page.

import { computed } from "@preact/signals";
import { answer, type Score } from "./api";
import { results } from "./jobs";
import type { Json } from "./state";

export type Check = Score["verdict"]["checks"][number];

const ORDER: Record<string, number> = { fail: 0, inconclusive: 1, pass: 2 };

/** The check that the verdict rests on, as the service's reports have it: the worst status, then the largest value over its limit. */
export function decisive(checks: readonly Check[]): Check | undefined {
  const urgency = (check: Check): [number, number] => [ORDER[check.status] ?? 1, -check.value_mm / check.limit_mm];
  return [...checks].sort((a, b) => urgency(a)[0] - urgency(b)[0] || urgency(a)[1] - urgency(b)[1])[0];
}

/** The verification of the design that the last score is of, with the most shots; null where the page knows of none. */
export const verified = computed<Json>(() => {
  const sha = answer.value?.score.provenance.design_sha256;
  if (!sha) return null;
  const found = Object.values(results.value).flatMap((record) => {
    if (record.provenance?.design_sha256 !== sha) return [];
    const own = record.verification ?? record.certificate?.verification ?? record; // a report's, an optimum's, or itself
    return own.trials && own.verdict ? [own] : [];
  });
  return found.sort((a, b) => b.trials - a.trials)[0] ?? null;
});
