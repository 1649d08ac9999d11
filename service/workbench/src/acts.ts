// What is done about a design by one press: it is verified, optimised, and an optimum is taken.

import { signal } from "@preact/signals";
import { advised, START, startOf } from "./advice";
import { answer, send } from "./api";
import { start } from "./jobs";
import { design, differences, edit, gesture, type Json, settled, whole } from "./state";

const TRIALS = 4_194_304; // that a check to a precision may draw, unless the operator allows fewer

export async function verify(): Promise<void> {
  const about = await send("GET", "/version").then((response) => response.json()).catch(() => ({})), most = Math.min(about.max_trials ?? TRIALS, TRIALS);
  await start("Verification and report", "/v1/reports", { precision: 0.005, ...(most < TRIALS ? { max_trials: most } : {}) });
}

/** Where an optimisation is to put beads instead of where the design says: where they touch the surface that was dropped. */
export const onSurface = signal<Json>(null);

export function optimise(): Promise<void> {
  const stated = design.value?.optimise, surface = onSurface.value, asked = stated ?? startOf(design.value, answer.value?.score ?? null);
  if (stated && !surface) return start("Optimisation", "/v1/optimisations", {});
  const { box, regions, ...rest } = asked, free = surface ? { ...rest, region: { surface } } : asked;
  return start(`Optimisation ${surface ? `with beads on ${surface.file}` : START}`, "/v1/optimisations", { design: { ...whole.value, optimise: free } });
}

export function takeOptimum(result: Json): void {
  gesture.value = [];
  const { review, ...optimum } = result.design, stated = settled.value.optimise; // comments and versions stay as they are now
  if (optimum.optimise?.region?.surface?.content) optimum.optimise = stated?.region?.surface ? { ...optimum.optimise, region: stated.region } : stated; // what a file holds stays out of the design
  edit(differences(settled.value, optimum), "Accept the optimum");
}

/** What the strip advises. */
export function takeAdvice(): void {
  const step = advised.value?.step;
  if (step) edit(step.edits, `Tighten ${step.words}`);
}
