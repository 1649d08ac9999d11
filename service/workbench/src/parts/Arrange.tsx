// What is done with several beads together, and what they keep while they are moved: fetched when it is opened.

import { signal } from "@preact/signals";
import { labelsLike, type Line, mirrored, onCircle, repeats, turned } from "../arrange";
import { adding, type Bead, beads, chosenBeads, keepRules, keeps, locked, pick, placing, rules, wrong } from "../beads";
import { rounded, type Vector } from "../geometry";
import { breaches } from "../keeping";
import { design, edit, type Edit, type Json, picked, say } from "../state";
import { brief, readNumber } from "../words";

const AXES = ["x", "y", "z"], THROUGH = { origin: "the origin", middle: "the middle of all beads", last: "the bead chosen last" };
const OWN = "own"; // the symmetry that the design asks its optimum for
const axis = signal("x"), through = signal<keyof typeof THROUGH>("origin"), degrees = signal(120), copies = signal(false);

/** The line that is chosen: across it is mirrored, about it turned. */
function line(all: readonly Bead[], chosen: readonly Bead[]): Line {
  const own = symmetry();
  if (axis.value === OWN && own) return own;
  const middle = [0, 1, 2].map((k) => all.reduce((sum, { position }) => sum + position[k], 0) / all.length) as Vector;
  const last = chosen.find(({ label }) => label === picked.value[picked.value.length - 1])?.position;
  return { point: { origin: [0, 0, 0] as Vector, middle, last: last ?? middle }[through.value], along: AXES.map((name) => Number(name === axis.value)) as Vector };
}

function symmetry(): Line | null {
  const { mirror, rotation } = design.value?.optimise?.symmetry ?? {}, along = mirror?.normal ?? rotation?.axis;
  return Array.isArray(along) ? { point: (mirror ?? rotation).point_mm ?? [0, 0, 0], along: along as Vector } : null;
}

/** Beads at their new places, or copies of them there; nothing, where that breaks what is kept. */
function arrange(what: string, chosen: readonly Bead[], rounds: Vector[][]): void {
  const all = beads.value, points: Json[] = design.value.fiducials.points, copying = copies.value && what !== CIRCLE;
  const names = copying ? labelsLike(rounds.flatMap(() => chosen.map(({ label }) => label)), all.map(({ label }) => label)) : chosen.map(({ label }) => label);
  const made = rounds.flat().map((position, k) => ({ label: names[k], position, of: chosen[k % chosen.length] })), stay = copying ? all : all.filter((bead) => !chosen.includes(bead));
  const broken = keeps.value ? made.flatMap(({ label, position }) => breaches(position, [...stay, ...made.filter((other) => other.label !== label)], rules.value).map(({ words }) => `${label} would be ${words}`)) : [];
  if (broken.length) return say(`${what}: nothing was changed, ${broken[0]}. Let go of what is kept, or choose another plane or axis.`, true);
  const edits: Edit[] = copying
    ? [...made.map(({ label, position, of }, k) => ({ path: ["fiducials", "points", points.length + k], value: { ...points[of.index], label, position_mm: rounded(position) } })),
      ...(design.value.views ?? []).flatMap((view: Json, k: number) => view.sees ? [{ path: ["views", k, "sees"], value: [...view.sees, ...made.filter(({ of }) => view.sees.includes(of.label)).map(({ label }) => label)] }] : [])]
    : made.map(({ position, of }) => placing(of.index, position));
  edit(edits, `${what}, ${made.length === 1 ? made[0].label : `${made.length} beads`}`);
  pick(names, false);
}

const CIRCLE = "On a circle";

export function Arrange() {
  const all = beads.value, chosen = chosenBeads.value, none = !chosen.length, { spacing_mm: spacing, zones } = rules.value;
  const own = symmetry(), at = line(all, chosen), k = AXES.indexOf(axis.value), words = k < 0 ? "the design's symmetry" : axis.value;
  const kept = [spacing ? `${brief(spacing)} mm apart` : "", zones.length ? `out of ${zones.map(({ name }) => name).join(", ")}` : ""].filter(Boolean).join(", ");
  const problems = chosen.flatMap(({ label }) => (wrong.value.has(label) ? [`${label}: ${wrong.value.get(label)}`] : []));
  const plane = k < 0 ? words : `${words} = ${brief(Math.round(1000 * at.point[k]) / 1000)}`;
  return (
    <section class="arrange" aria-label="Arrange beads">
      <p class="controls">
        <span>{none ? "No bead is chosen" : chosen.length > 8 ? `${chosen.length} beads` : chosen.map(({ label }) => label).join(", ")}</span>
        <button type="button" class="small" onClick={() => pick(all.map(({ label }) => label), false)}>All</button>
        <button type="button" class="small" disabled={none} onClick={() => pick([], false)}>None</button>
        <button type="button" class="small" aria-pressed={adding.value} title="A press adds a bead, as with Shift; a drag over the ground draws a frame" onClick={() => (adding.value = !adding.value)}>Several</button>
      </p>
      <p class="controls" role="group" aria-label="What moving keeps">
        <span>Lock</span>
        {AXES.map((name, n) => <button type="button" key={name} class="small" aria-label={`Lock ${name}`} aria-pressed={locked.value[n]} onClick={() => (locked.value = locked.value.map((on, m) => (m === n ? !on : on)))}>{name}</button>)}
        {kept ? <button type="button" class="small" aria-pressed={keeps.value} onClick={() => keepRules(!keeps.value)}>{`Keep ${kept}`}</button> : <span class="note">spacing and zones of an optimise section would be kept</span>}
      </p>
      <p class="controls" role="group" aria-label="Mirror, turn, distribute">
        <label>Axis <select value={axis.value} onChange={(event) => (axis.value = event.currentTarget.value)}>{AXES.map((name) => <option key={name}>{name}</option>)}{own && <option value={OWN}>the design's symmetry</option>}</select></label>
        {axis.value !== OWN && <label>through <select value={through.value} onChange={(event) => (through.value = event.currentTarget.value as keyof typeof THROUGH)}>{Object.entries(THROUGH).map(([name, said]) => <option key={name} value={name}>{said}</option>)}</select></label>}
        <button type="button" class="small" aria-pressed={copies.value} onClick={() => (copies.value = !copies.value)}>Copies</button>
        <button type="button" class="small" disabled={none} onClick={() => arrange(`Mirror in ${plane}`, chosen, [chosen.map(({ position }) => mirrored(position, at))])}>{`Mirror in ${plane}`}</button>
        <button type="button" class="small" disabled={none} onClick={() => arrange(`Turn by ${degrees.value}° about ${words}`, chosen, Array.from({ length: copies.value ? repeats(degrees.value) : 1 }, (_, n) => chosen.map(({ position }) => turned(position, at, (n + 1) * degrees.value))))}>{`Turn about ${words}`}</button>
        <label class="field">by <input type="text" inputMode="decimal" aria-label="Turn by, °" defaultValue={String(degrees.value)} onInput={(event) => {
          const read = readNumber(event.currentTarget.value, "°"), good = read !== null && read !== 0;
          event.currentTarget.setAttribute("aria-invalid", String(!good));
          if (good) degrees.value = read;
        }} /> °</label>
        <button type="button" class="small" disabled={chosen.length < 3} title="At equal angles about the axis, at their mean distance and height" onClick={() => arrange(CIRCLE, chosen, [onCircle(chosen.map(({ position }) => position), at)])}>{CIRCLE}</button>
      </p>
      {problems.length > 0 && <p class="note bad" role="status">{problems.slice(0, 4).join("; ")}</p>}
    </section>
  );
}
