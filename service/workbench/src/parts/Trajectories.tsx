// Down each planned trajectory: the corridor that its axis has to stay in, and fifty executed axes of a simulation, to scale.

import { across, add, cross, dot, roundStep, unit, type Vector } from "../geometry";
import { brief } from "../words";
import type { Item, Scene } from "./hands";

type Flat = [number, number];
interface Drawn {
  name: string;
  words: string; // of the corridor; empty where there is none
  rims: Flat[][]; // where the axis enters, and at its end
  shots: { ends: [Flat, Flat]; inside: boolean }[];
}

/** Half-axes of a rim, which begins on the one and is on the other after a quarter. */
const within = (rim: Flat[], [x, y]: Flat) => {
  const [a, b] = [rim[0], rim[(rim.length - 1) / 4]];
  return Math.hypot(...[a, b].map(([u, v]) => (x * u + y * v) / (u * u + v * v))) <= 1;
};

/** What the scene has of them, as it is: there errors are magnified about the planned axis. */
export function drawnOf({ items, magnification }: Scene): Drawn[] {
  if (!magnification) return [];
  return items.filter(({ look }) => look === "trajectory").map(({ points: [begin, end], title = "" }) => {
    const name = title.replace("trajectory ", ""), along = unit(add(end, begin, -1)), right = across(along), up = cross(along, right) as Vector;
    const flat = (point: Vector, from: Vector): Flat => { const by = add(point, from, -1); return [dot(by, right) / magnification, dot(by, up) / magnification]; };
    const own = items.filter((item: Item) => item.layer === "corridor" && item.title?.startsWith(`corridor of ${name}: `)), [entry, tip] = own.filter(({ points }) => points.length > 2), rims = entry ? [entry.points.map((p) => flat(p, begin)), tip.points.map((p) => flat(p, end))] : [];
    const shots = items.filter(({ look, title: each = "" }) => look === "executed" && each.startsWith(`${name}: `)).map(({ points: [a, b] }) => {
      const ends: [Flat, Flat] = [flat(a, begin), flat(b, end)];
      return { ends, inside: !rims.length || ends.every((at, k) => within(rims[k], at)) };
    });
    return { name, words: own[0]?.title?.replace(`corridor of ${name}: `, "") ?? "", rims, shots };
  });
}

const SIDE = 200, EDGE = 8;
export function Trajectories({ scene, old }: { scene: Scene; old: boolean }) {
  return (
    <>
      {drawnOf(scene).map(({ name, words, rims, shots }) => {
        const most = Math.max(1e-9, ...[...rims.flat(), ...shots.flatMap(({ ends }) => ends)].map(([x, y]) => Math.hypot(x, y))), scale = (SIDE / 2 - EDGE) / most, out = shots.filter(({ inside }) => !inside).length, bar = roundStep(most / 2);
        const at = ([x, y]: Flat): Flat => [SIDE / 2 + scale * x, SIDE / 2 - scale * y], told = `Down the trajectory ${name}: the ends of ${shots.length} executed axes of a simulation (ring: entry, dot: end)${rims.length ? `; ${out} ${out === 1 ? "leaves" : "leave"} the corridor, ${words}` : ""}.`;
        return (
          <figure key={name} class={old ? "picture trajectory old" : "picture trajectory"} data-out={out}>
            <svg viewBox={`0 0 ${SIDE} ${SIDE}`} role="img" aria-label={told}>
              {rims.map((rim, k) => <path key={k} class={k ? "rim" : "rim entry"} d={rim.map((point, n) => `${n ? "L" : "M"}${at(point).join(" ")}`).join("")} />)}
              <path class="cross" d={`M${SIDE / 2 - 5} ${SIDE / 2}h10M${SIDE / 2} ${SIDE / 2 - 5}v10`} />
              {shots.map(({ ends: [a, b], inside }, k) => (
                <g key={k} class={inside ? "executed" : "executed out"}><path d={`M${at(a).join(" ")}L${at(b).join(" ")}`} /><circle class="begin" cx={at(a)[0]} cy={at(a)[1]} r={2.2} /><circle cx={at(b)[0]} cy={at(b)[1]} r={2.2} /></g>
              ))}
              <g class="scale"><path d={`M${EDGE} ${SIDE - 4}h${bar * scale}`} /><text x={EDGE} y={SIDE - 8} font-size={10}>{`${brief(bar)} mm`}</text></g>
            </svg>
            <figcaption>{told}</figcaption>
          </figure>
        );
      })}
    </>
  );
}
