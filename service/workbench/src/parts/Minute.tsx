// The first minute, on the drill guide: what to do, one thing after the other; each is done when its effect is seen.

import { computed, effect, signal } from "@preact/signals";
import { advised } from "../advice";
import { answer, current } from "../api";
import { design, gesture, position, recall, remember, steps } from "../state";
import { verified } from "../readings";

const KEY = "tailstack.workbench.minute", BEAD = "F10", ENDED = 4;
const kept = signal({ step: 0, of: "", ...recall<object>(KEY, {}) }); // of: name of the design
const step = computed(() => (kept.value.of && design.value?.name === kept.value.of ? kept.value.step : 0));
/** The bead that is to be dragged. */
export const hinted = computed(() => (step.value === 1 ? BEAD : null));
const go = (to: number, of = kept.value.of) => {
  kept.value = { step: to, of };
  remember(KEY, kept.value);
};

/** With the drill guide that was just opened; whoever has ended it once is left alone. */
export function beginMinute(): void {
  if (kept.value.step < ENDED) go(1, String(design.value?.name));
}

effect(() => {
  if (!current.value || gesture.value.length) return;
  if (step.value < ENDED && step.value && verified.value) go(ENDED);
  else if (step.value < 3 && step.value && answer.value!.score.verdict.status === "pass") go(3);
  else if (step.value === 3 && answer.value!.score.verdict.status === "fail") go(2); // undone
  else if (step.value === 1 && /^Move /.test(steps.value[position.value]?.what ?? "")) go(2);
});

const WORDS = () => [
  `The tool may miss by more than the limit: the strip says by how much. Press the ringed bead ${BEAD} in a picture, drag it, and watch that number.`,
  `▲ or ▼ says what that did. The list says what is to blame: ${advised.value?.wall ? "but no tightening keeps this limit, as the strip says. Undo, or type a wider one." : "press Tighten in the strip, or slide rx and ry of the connector to the left, until it passes."}`,
  "It passes by estimate. Verify simulates it, shot by shot, and makes the report.",
];

export function Minute() {
  const all = WORDS(), words = all[step.value - 1];
  return words ? (
    <p class="minute" role="note" aria-label="The first minute"><strong>{`${step.value} of ${all.length}`}</strong><span>{words}</span><button type="button" class="small" onClick={() => go(ENDED)}>Skip</button></p>
  ) : null;
}
