// What each lever can reach by itself, beside the verdict: a bar a lever with the limit across, before anybody pulls.

import { computed, effect, signal } from "@preact/signals";
import { answer, askWhenQuiet, current, refused, type Score, send } from "../api";
import { freesBeads } from "../beads";
import { answering, estimated, known, shown as reading, standing } from "../readings";
import { design, gesture, type Json, opened } from "../state";
import { mm, sign } from "../words";
import { pulling } from "./Limit";

type Lever = NonNullable<Score["levers"]>[number];

const QUIET = 900; // ms without a change, after which places of the beads are searched, which takes seconds
const found = signal<{ design: Json; levers: readonly Lever[] } | null>(null); // with what a search knows
const held = signal<{ design: Json; levers: readonly Lever[] } | null>(null); // of the last score that tells them
const searching = signal(false);

effect(() => {
  if (opened.value) held.value = null; // those of another design say nothing of this one
});
effect(() => {
  const score = answer.value?.score;
  if (score?.levers?.length) held.value = { design: answer.value!.design, levers: score.levers };
});
effect(() => {
  const data = design.value, allowed = data?.optimise, adds = Array.isArray(allowed?.views) && allowed.views.some((each: Json) => each?.add);
  if (!(freesBeads(allowed) || adds) || !current.value || refused.value || gesture.value.length || pulling.value || held.value?.design !== data || found.peek()?.design === data) return;
  const leave = askWhenQuiet(QUIET, async (left) => {
    searching.value = true;
    const response = await send("POST", "/v1/scores", { design: data, search: true }, {}, left).catch(() => null);
    if (response?.ok) found.value = { design: data, levers: ((await response.json()) as Score).levers ?? [] };
    if (!left.aborted) searching.value = false;
  });
  return () => {
    leave(); // the service ends it, too
    searching.value = false;
  };
});

/** Of the requirement that decides, with what it comes to as the design is. */
const shown = computed(() => {
  const all = found.value?.design === held.value?.design ? found.value : held.value, check = answering(known.value), name = check?.requirement ?? "";
  if (!all || !estimated.value) return null;
  const worst = Math.max(...estimated.value.record.verdict.checks.filter(({ requirement }) => requirement === name).map(({ value }) => value));
  return { levers: all.levers.filter(({ requirement }) => requirement === name), now: check ? worst : estimated.value.value, limit: check?.limit ?? null, unit: check?.unit ?? "mm", digits: estimated.value.digits, name, old: all.design !== design.value };
});

const FIRST = 5; // levers that are shown before the others are asked for
const every = signal(false); // whether all are shown
const HOW: Record<Lever["how"], string> = { perfect: "were it perfect", least: "at its smallest allowed", bound: "not below", found: "by a search" };

/** The two that lead furthest, where they would be best, or that nothing leads within the limit: in the strip. */
export function Reach() {
  const of = shown.value;
  if (!of || of.old || !of.levers.length || !standing.value.holds || reading.value!.record.verdict.status === "pass") return null;
  const { levers, limit, unit, digits: d } = of, all = levers.find(({ name }) => name === "together"), beads = levers.find(({ name }) => name === "placement");
  if (all && limit !== null && all.value > limit) return <p class="note reach" data-kind="estimate">{`An optimisation leads no further than ${mm(all.value, d)}${sign(unit)}, by estimate: ${all.label}.`}</p>;
  const first = levers.filter(({ how, name }) => how !== "bound" && name !== "placement").slice(0, 2).map(({ label, value }) => `${label} ${mm(value, d)}`);
  return <p class="note reach" data-kind="estimate">{`Alone at best: ${[...first, beads && `beads elsewhere ${beads.how === "bound" ? "not below " : ""}${mm(beads.value, d)}`].filter(Boolean).join(", ")}${sign(unit)}.`}</p>;
}

export function Levers() {
  const of = shown.value;
  if (!of?.levers.length) return <p class="note">{answer.value?.score.levers?.length === 0 ? "How far each lever leads is not known where fiducials are missed." : "It comes with the next score."}</p>;
  const { levers, now, limit, unit, digits: d, name, old } = of, most = 1.04 * Math.max(now, limit ?? 0), x = (value: number) => (100 * value) / most;
  return (
    <div class={old || !standing.value.holds ? "levers outdated" : "levers"} data-kind="estimate">
      <table>
        <caption>{`${name || "P95"} is ${mm(now, d)}${sign(unit)}${limit === null ? "" : `, the limit (the line) ${limit}${sign(unit)}`}; by one lever alone, by estimate:`}</caption>
        <colgroup><col /><col /><col /><col /></colgroup>
        <thead class="hidden"><tr><th>Lever</th><th>Bar</th><th>{`At its best, ${unit}`}</th><th>What that is</th></tr></thead>
        <tbody>
          {levers.map((lever, k) => (
            <tr key={lever.name} class={`${limit !== null && lever.value <= limit ? "keeps" : ""}${every.value || k < FIRST ? "" : " folded"}`}>
              <th scope="row" title={lever.label}>{lever.label}</th>
              <td class="reached"><svg viewBox="0 0 100 10" preserveAspectRatio="none" aria-hidden="true"><rect class="now" width={x(now)} height="10" /><rect class="best" width={x(lever.value)} height="10" />{limit !== null && <path d={`M${x(limit)} 0V10`} />}</svg></td>
              <td class="number">{mm(lever.value, d)}</td>
              <td class="note">{lever.name === "placement" && searching.value ? "searching …" : HOW[lever.how]}</td>
            </tr>
          ))}
        </tbody>
      </table>
      {levers.length > FIRST && <button type="button" class="fold" aria-expanded={every.value} onClick={() => (every.value = !every.value)}>{`All ${levers.length} levers`}</button>}
    </div>
  );
}
