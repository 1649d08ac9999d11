// The layout in space, by the module that turns it in reports; what is taken hold of there is moved.

import { useEffect, useMemo, useRef } from "preact/hooks";
import "../../../tailstack_service/report/templates/viewer.css";
import "../../../tailstack_service/report/templates/viewer.js";
import { onSurface } from "../acts";
import { drawn, layout } from "../api";
import { wrong } from "../beads";
import { worthy } from "../best";
import { carrier, removeSurface, optimiseOnIt, radius, sizeOf, snaps, UNITS } from "../carrier";
import type { Vector } from "../geometry";
import { design, picked, pointed, selected } from "../state";
import { brief } from "../words";
import { shows } from "./Places";
import { Trajectories } from "./Trajectories";
import { followed, hand, handles, said, type Scene, takeHold, type Viewer } from "./hands";

declare global {
  interface Window {
    LayoutViewer: new (figure: HTMLElement, scene: unknown, number: number) => Viewer;
  }
}

const WORTHY_MM = 5; // as reports have it

/** With balls where fiducials tell most, as reports draw them. */
function withWorthy(scene: Scene): Scene {
  if (!shows("best") || !worthy.value.length) return scene;
  const items = worthy.value.map(({ position_mm: at, fiducials: many }) => {
    const radius = WORTHY_MM * Math.cbrt(many), axes = [0, 1, 2].map((k) => [0, 1, 2].map((m) => (m === k ? radius : 0)) as Vector);
    return { kind: "ellipsoid", layer: "worthy", look: "worthy", points: [at as Vector, ...axes], label: "", title: `the best mixture of layouts has ${brief(many)} fiducials here` };
  });
  return { ...scene, items: [...scene.items, ...items], layers: [...scene.layers, { key: "worthy", label: "Where fiducials tell most", shown: true }] };
}

export function Space() {
  const figure = useRef<HTMLElement>(null), viewer = useRef<Viewer | null>(null), marked = pointed.value ?? selected.value;
  const own = layout.value?.scene ? followed(layout.value.scene as unknown as Scene, drawn.value, design.value) : null;
  const scene = useMemo(() => own && withWorthy(own), [own, worthy.value, shows("best")]);
  useEffect(() => {
    if (!scene || !figure.current) return;
    if (viewer.current) return viewer.current.update(scene);
    viewer.current = new window.LayoutViewer(figure.current, scene, 1);
    viewer.current.canvas.setAttribute("aria-describedby", "viewer-1-words viewer-1-help hands");
  }, [scene]);
  useEffect(() => { // what tests and curious people look at, as in main.tsx
    Object.assign((window as unknown as { workbench: object }).workbench, { handles: () => viewer.current && handles(viewer.current).map(({ words, position }) => ({ words, at: viewer.current!.page(position) })) });
  }, []);
  useEffect(() => (viewer.current ? takeHold(viewer.current, figure.current!) : undefined), [viewer.current !== null || scene !== null]);
  useEffect(() => viewer.current?.point(marked), [scene, marked]);
  useEffect(() => viewer.current?.draw(), [carrier.value, picked.value, wrong.value, hand.value]);
  useEffect(() => figure.current!.addEventListener("point", (event) => (pointed.value = (event as CustomEvent<string | null>).detail)), []);
  const held = viewer.current && handles(viewer.current).find(({ key }) => key === hand.value);
  return (
    <>
      <figure ref={figure} hidden={!scene} class={drawn.value === design.value ? "space" : "space old"} />
      {scene && (
        <p id="hands" class={said.value || held ? "note" : "note idle"} role="status">
          {said.value || (held ? `${held.words}: ${held.turn ? "the arrows turn it by 1° and tilt it" : "the arrows move it by 1 mm, in the plane that you look at"}; Escape lets go` : "Drag a bead, pivot, locator or beam to move it; with Shift along an axis. N and P take one for the arrows")}
        </p>
      )}
      {layout.value?.scene && <Trajectories scene={layout.value.scene as unknown as Scene} old={drawn.value !== design.value} />}
    </>
  );
}

/** What is known of the surface that was dropped, and what beads do there. */
export function Surface() {
  const own = carrier.value!;
  return (
    <p class="controls surface" role="group" aria-label="Surface">
      <span>{`${own.name}: ${(own.mesh.corners.length / 9).toLocaleString("en")} triangles, ${sizeOf(own)}`}</span>
      <label>in <select value={own.unit} onChange={(event) => (carrier.value = { ...own, unit: event.currentTarget.value })}>{Object.keys(UNITS).map((unit) => <option key={unit}>{unit}</option>)}</select></label>
      <button type="button" class="small" aria-pressed={snaps.value} title={`Beads of ${brief(2 * radius.value)} mm that are dragged in space touch it from outside`} onClick={() => (snaps.value = !snaps.value)}>{`Beads touch it, ${brief(2 * radius.value)} mm`}</button>
      <label>Optimise puts beads <select value={onSurface.value?.side ?? ""} onChange={(event) => optimiseOnIt(event.currentTarget.value)}>
        <option value="">where the design says</option><option value="outside">on its outside</option><option value="inside">on its inside</option><option value="both">on either side</option>
      </select></label>
      <button type="button" class="small" aria-label={`Take ${own.name} away`} onClick={removeSurface}>×</button>
    </p>
  );
}
