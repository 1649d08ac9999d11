// What is done about a design by one press: it is verified, optimised, and an optimum is taken.

import { advised, START, startOf } from "./advice";
import { answer, send } from "./api";
import { start } from "./jobs";
import { design, differences, edit, gesture, type Json, settled, whole } from "./state";

const TRIALS = 4_194_304; // that a check to a precision may draw, unless the operator allows fewer

export async function verify(): Promise<void> {
  const about = await send("GET", "/version").then((response) => response.json()).catch(() => ({})), most = Math.min(about.max_trials ?? TRIALS, TRIALS);
  await start("Verification and report", "/v1/reports", { precision: 0.005, ...(most < TRIALS ? { max_trials: most } : {}) });
}

export const optimise = () => design.value?.optimise
  ? start("Optimisation", "/v1/optimisations", {})
  : start(`Optimisation ${START}`, "/v1/optimisations", { design: { ...whole.value, optimise: startOf(design.value, answer.value?.score ?? null) } });

export function takeOptimum(result: Json): void {
  gesture.value = [];
  const { review, ...optimum } = result.design; // comments and versions stay as they are now
  edit(differences(settled.value, optimum), "Accept the optimum");
}

/** What the strip advises. */
export function takeAdvice(): void {
  const step = advised.value?.step;
  if (step) edit(step.edits, `Tighten ${step.words}`);
}
