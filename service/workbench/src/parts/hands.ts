// Beads, pivots, seats and beams taken hold of in space: by the pointer, a finger, or with keys.  The viewer turns and draws
// the layout, in reports too; here is what a page does with it that changes the design.

import { signal } from "@preact/signals";
import { adding, beads, called, movingTo, nameOf, pick, stopped, toggle, wrong } from "../beads";
import { seenAt, snaps, stepped, surface, touching } from "../carrier";
import { turned } from "../arrange";
import { SEATS } from "../document";
import { add, cross, dot, length, type Pixel, rounded, unit, type Vector } from "../geometry";
import { type Mesh, picture, type Seen } from "../mesh";
import { cancelGesture, design, type Edit, edit, finishGesture, gesture, type Json, picked, type Path, pointed, PRESSES, preview, say, selected, settled } from "../state";
import { NUDGE } from "./grip";

export interface Item {
  kind: string;
  layer: string;
  look: string;
  points: Vector[];
  label: string;
  title?: string;
}
export interface Scene {
  items: Item[];
  layers: { key: string; label: string; shown: boolean }[];
  magnification: number; // of errors; 0 where there are none
}
export interface Viewer extends Seen {
  canvas: HTMLCanvasElement;
  scene: Scene;
  extent: "near" | "far";
  under?(context: CanvasRenderingContext2D): void;
  over?(context: CanvasRenderingContext2D): void;
  page(point: Vector): Pixel;
  draw(): void;
  tell(at: Pixel | null): void;
  update(scene: Scene): void;
  point(label: string | null): void;
}

/** What can be taken hold of. */
interface Handle {
  key: string;
  words: string;
  what: string; // of the step that moving it is
  position: Vector;
  to(place: Vector, sight: Vector): Edit[] | null; // edits that bring it to a place, seen along a line of sight
  step?(by: Vector): Edit[] | null; // and by a step of a key, where that is another
  turn?: Beam;
}
interface Beam {
  view: number;
  name: string;
  centre: Vector; // what it turns about
  direction: Vector;
  up: Vector;
}

const AIMED = /^(orientation|beam_direction)$/, ALONG: Record<string, Vector> = { AP: [0, 1, 0], LAT: [-1, 0, 0] };
const isPoint = (value: Json): value is Vector => Array.isArray(value) && value.length === 3 && value.every((v) => typeof v === "number" && Number.isFinite(v));
const HAND_EYE = "execution/hand_eye/pivot_mm"; // stated in the frame tcp
const REACH = 12, STILL = 3, FINE = 0.1, STEEPEST = 0.98; // pixels; a beam's cosine to what is up in its image

/** Handles of the design, beads first. */
export function handles(viewer: Viewer): Handle[] {
  const data = design.value, found: Handle[] = beads.value.map(({ label, position }) => ({
    key: `bead ${label}`, words: label, what: `Move ${called(label)}`, position,
    to: (place, sight) => (surface.value && snaps.value ? touching(label, seenAt(place, sight)) : movingTo(label, place)),
    step: (by) => (surface.value && snaps.value ? touching(label, stepped(position, by)) : movingTo(label, add(position, by))),
  }));
  const point = (words: string, path: Path, position: Json) => {
    if (isPoint(position)) found.push({ key: path.join("/"), words, what: `Move ${words}`, position, to: (place) => [{ path, value: rounded(place) }] });
  };
  SEATS.forEach((seat, k) => {
    const part = data?.interfaces?.[seat], drawn = viewer.scene.items.some(({ look }) => look === `pivot ${k + 1}`);
    if (drawn) point(`pivot ${k + 1}`, ["interfaces", seat, "pivot_mm"], part?.pivot_mm);
    if (Array.isArray(part?.locators)) part.locators.forEach((locator: Json, n: number) => point(`locator ${locator?.name ?? n + 1}`, ["interfaces", seat, "locators", n, "position_mm"], locator?.position_mm));
  });
  const eye = data?.execution?.hand_eye, axes = axesOf(viewer.scene, "tcp"), turns = [eye?.tolerances, eye?.bias].some((part) => Object.keys(part ?? {}).some((name) => /^(r[xyz]|cov)/.test(name)));
  if (axes && turns) { // of one that only shifts the pivot means nothing
    const pivot: Vector = isPoint(eye.pivot_mm) ? eye.pivot_mm : [0, 0, 0], position = pivot.reduce((at, v, k) => add(at, axes.along[k], v), axes.origin);
    found.push({ key: HAND_EYE, words: "pivot of the hand-eye", what: "Move the pivot of the hand-eye", position, to: (place) => [{ path: HAND_EYE.split("/"), value: rounded(pivot.map((v, k) => v + dot(axes.along[k], add(place, position, -1))) as Vector) }] });
  }
  (Array.isArray(data?.views) ? data.views : []).forEach((view: Json, k: number) => {
    const direction = view?.beam_direction ?? ALONG[view?.orientation], up = view?.up_direction ?? [0, 0, 1], drawn = beamOf(viewer, String(view?.name));
    if (!drawn || !isPoint(direction) || !isPoint(up)) return;
    const turn = { view: k, name: String(view.name), direction, up, centre: viewer.extent === "far" ? view.isocentre_mm ?? [0, 0, 0] : drawn.centre };
    found.push({ key: `view ${k}`, words: `beam of ${view.name}`, what: `Turn ${view.name}`, position: drawn.tail, to: () => null, turn });
  });
  return found;
}

/** Origin and unit vectors of a frame, in con, as they are drawn. */
function axesOf({ items }: Scene, frame: string): { origin: Vector; along: Vector[] } | null {
  const arrows = items.filter(({ layer, title }) => layer === "frames" && title?.split(/[ ,=]+/).includes(frame)).map(({ points }) => points);
  return arrows.length === 3 ? { origin: arrows[0][0], along: arrows.map(([from, to]) => unit(add(to, from, -1))) } : null;
}

/** Where a view's beam is held: at its source, or close up at the end of the arrow that stands for it. */
function beamOf({ scene, extent }: Viewer, name: string): { tail: Vector; centre: Vector } | null {
  const of = (layer: string, begin: string) => scene.items.find((item) => item.layer === layer && (item.title === begin || item.title?.startsWith(`${begin}:`)))?.points;
  if (extent === "far") {
    const source = of("beams", `source of view ${name}`)?.[0];
    return source ? { tail: source, centre: source } : null;
  }
  const arrow = of("directions", `beam of view ${name}`);
  return arrow ? { tail: arrow[0], centre: add(arrow[0], add(arrow[1], arrow[0], -1), 1.5 / 0.35) } : null; // as report/scene.py places it
}

/** Edits by which a beam goes another way. */
function aiming({ view }: Beam, direction: Vector): Edit[] {
  const long = length(direction), stated = Object.keys(settled.value.views[view]).filter((field) => AIMED.test(field) && field !== "beam_direction");
  return [...stated.map((field) => ({ path: ["views", view, field], value: undefined })), { path: ["views", view, "beam_direction"], value: rounded(direction.map((v) => v / long), 6) }];
}
const arc = ({ centre, up }: Beam, position: Vector, degrees: number) => turned(position, { point: centre, along: up }, degrees);
const aimed = ({ direction, up }: Beam, degrees: number) => turned(direction, { point: [0, 0, 0], along: up }, degrees);

/** The beam with its source up or down in the image; as it is, where that would be along what is up. */
function tilted({ direction, up }: Beam, degrees: number): Vector {
  const next = turned(direction, { point: [0, 0, 0], along: cross(direction, up) }, degrees);
  return Math.abs(dot(next, up)) < STEEPEST * length(next) * length(up) ? next : direction;
}

export const hand = signal<string | null>(null); // key of what keys move here, or null: they turn the view
export const said = signal(""); // while something is held

/** The layout as it is drawn while the design is ahead of what the service said of it: points that moved, moved. */
export function followed(scene: Scene, was: Json, now: Json): Scene {
  if (was === now) return scene;
  const moves = new Map<string, { to: Vector; words?: string }>(), key = (p: Vector) => rounded(p).join();
  const note = (from: Json, to: Json, words?: string) => isPoint(from) && isPoint(to) && key(from) !== key(to) && moves.set(key(from), { to: rounded(to), words });
  const places = new Map<string, Vector>((was?.fiducials?.points ?? []).map((each: Json, k: number) => [nameOf(each, k), each?.position_mm]));
  for (const { label, position } of beads.value) note(places.get(label), position, `fiducial ${label}: ${["x", "y", "z"].map((name, k) => `${name} ${position[k].toFixed(2)}`).join(", ")} mm`);
  for (const seat of SEATS) {
    const [old, next] = [was, now].map((data) => data?.interfaces?.[seat]);
    note(old?.pivot_mm, next?.pivot_mm);
    (Array.isArray(old?.locators) ? old.locators : []).forEach((locator: Json, k: number) => note(locator?.position_mm, next?.locators?.[k]?.position_mm));
  }
  if (!moves.size) return scene;
  const items = scene.items.map((item) => {
    const [first, last] = [item.points[0], item.points[item.points.length - 1]];
    if (item.layer === "locators") {
      const { to } = moves.get(key(last)) ?? {};
      return to ? { ...item, points: [add(to, add(first, last, -1)), to] } : item;
    }
    if (!/^(fiducials|pivots|levers)$/.test(item.layer) && item.look !== "drop") return item;
    const { to, words } = moves.get(key(first)) ?? {};
    if (!to) return item;
    return { ...item, title: item.layer === "fiducials" && words ? words : item.title, points: item.look === "drop" ? [to, [to[0], to[1], last[2]] as Vector] : [to, ...item.points.slice(1)] };
  });
  return { ...scene, items };
}

/** Listen in a viewer's figure, before the viewer does; returns what ends it. */
export function takeHold(viewer: Viewer, figure: HTMLElement): () => void {
  const { canvas } = viewer, sight = () => cross(viewer.right, viewer.up).map((v) => -v) as Vector;
  let held: { handle: Handle; from: Pixel; moved: boolean; more: boolean; angle: number } | null = null;
  let band: { from: Pixel; to: Pixel; more: boolean } | null = null, tapped: { key: string; from: Pixel } | null = null;

  const far = (a: Pixel, b: Pixel) => Math.hypot(a[0] - b[0], a[1] - b[1]);
  const under = (at: Pixel) => handles(viewer).map((handle) => ({ handle, away: far(viewer.page(handle.position), at) })).filter(({ away }) => away < REACH).sort((a, b) => a.away - b.away)[0]?.handle;
  const labelOf = (key: string) => (key.startsWith("bead ") ? key.slice(5) : null);
  const choose = (handle: Handle, more = false) => {
    const label = labelOf(handle.key);
    hand.value = handle.key;
    if (label !== null && more) toggle(label);
    else if (label !== null && picked.value.includes(label)) pick([label], true);
    else selected.value = label;
  };
  const told = () => {
    if (stopped.value) say(`It stays: there it would be ${stopped.value}. "Arrange" has what is kept.`);
    stopped.value = null;
    said.value = "";
  };

  /** Where what is held is to be: in the plane that faces the viewer, or with Shift along the axis of con that is nearest
   * to how the pointer moves. */
  const placeOf = (start: Vector, [x, y]: Pixel, along: boolean): Vector => {
    if (!along) return add(add(start, viewer.right, x / viewer.scale), viewer.up, -y / viewer.scale);
    const ways = [0, 1, 2].map((k) => [viewer.right[k] * viewer.scale, -viewer.up[k] * viewer.scale]), with_ = ([a, b]: number[]) => (Math.hypot(a, b) > 0.05 * viewer.scale ? Math.abs(a * x + b * y) / Math.hypot(a, b) : 0);
    const axis = [0, 1, 2].reduce((best, k) => (with_(ways[k]) > with_(ways[best]) ? k : best)), [a, b] = ways[axis];
    said.value = `along ${"xyz"[axis]}`;
    return start.map((v, k) => (k === axis ? v + (a * x + b * y) / (a * a + b * b) : v)) as Vector;
  };
  /** The angle by which a beam's handle is nearest to the pointer, near to what it was. */
  const angleOf = (turn: Beam, start: Vector, at: Pixel, last: number, fine: boolean) => {
    const away = (angle: number) => far(viewer.page(arc(turn, start, angle)), at), step = fine ? FINE : 1;
    let best = last;
    for (let k = -40 / step; k <= 40 / step; k += 1) if (away(Math.round(last / step) * step + k * step) < away(best)) best = Math.round(last / step) * step + k * step;
    return Number(best.toFixed(1));
  };
  const drag = (at: Pixel, event: PointerEvent) => {
    const { handle, from } = held!, { turn } = handle;
    if (turn) {
      held!.angle = angleOf(turn, handle.position, at, held!.angle, event.altKey);
      said.value = `${turn.name} turned by ${held!.angle}°`.replace("-", "−");
      return preview(held!.angle ? aiming(turn, aimed(turn, held!.angle)) : []);
    }
    said.value = "";
    const edits = handle.to(placeOf(handle.position, [at[0] - from[0], at[1] - from[1]], event.shiftKey), sight());
    if (edits) preview(edits);
  };

  const stop = (event: Event) => {
    event.stopPropagation();
    event.preventDefault();
  };
  const down = (event: PointerEvent) => {
    if (event.target !== canvas || event.button || !event.isPrimary) return;
    const at: Pixel = [event.offsetX, event.offsetY], found = under(at), more = event.shiftKey || adding.value;
    const frames = !found && (adding.value || event.ctrlKey || event.metaKey);
    if (!found && !frames) return;
    const label = found && labelOf(found.key), known = label != null ? picked.value.includes(label) : hand.value === found?.key;
    if (found && event.pointerType === "touch" && !known && !more) return void (tapped = { key: found.key, from: at }); // a finger turns the view, and holds what it chose before
    stop(event);
    canvas.focus({ preventScroll: true });
    canvas.setPointerCapture(event.pointerId);
    viewer.tell(null);
    if (!found) return void (band = { from: at, to: at, more: event.shiftKey || adding.value });
    if (!more) choose(found);
    held = { handle: found, from: at, moved: false, more, angle: 0 };
  };
  const move = (event: PointerEvent) => {
    const at: Pixel = [event.offsetX, event.offsetY];
    if (tapped && far(tapped.from, at) > STILL) tapped = null;
    if (!held && !band) return void (canvas.style.cursor = event.target === canvas && !event.buttons && under(at) ? "move" : "");
    stop(event);
    if (band) {
      band.to = at;
      return viewer.draw();
    }
    const begins = !held!.moved && far(held!.from, at) > STILL;
    held!.moved ||= begins;
    const label = labelOf(held!.handle.key);
    if (begins && held!.more && label !== null && !picked.value.includes(label)) choose(held!.handle);
    if (held!.moved) drag(at, event);
  };
  const up = (event: PointerEvent) => {
    if (tapped) {
      const found = handles(viewer).find(({ key }) => key === tapped!.key);
      tapped = null;
      if (found) choose(found);
    }
    if (!held && !band) return;
    event.stopPropagation();
    if (band) {
      const [[l, r], [t, b]] = [0, 1].map((k) => [Math.min(band!.from[k], band!.to[k]), Math.max(band!.from[k], band!.to[k])]);
      const inside = ([x, y]: Pixel) => x >= l && x <= r && y >= t && y <= b, more = band.more;
      band = null;
      pick(beads.value.filter(({ position }) => inside(viewer.page(position))).map(({ label }) => label), more);
      return viewer.draw();
    }
    const { handle, moved, more } = held!;
    held = null;
    if (moved) finishGesture(handle.what);
    else if (more) choose(handle, true);
    told();
  };
  const cancel = () => {
    held = band = tapped = null;
    cancelGesture();
    said.value = "";
  };
  const key = (event: KeyboardEvent) => {
    if (event.target !== canvas) return;
    const way = ({ ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] } as Record<string, Pixel>)[event.key], all = handles(viewer), now = all.findIndex((handle) => handle.key === hand.value);
    if (event.key === "Escape") {
      if (!held && !gesture.value.length && hand.value === null) selected.value = null;
      if (!held && !gesture.value.length) hand.value = null;
      cancel();
    } else if (event.key.toLowerCase() === "a" && (event.ctrlKey || event.metaKey)) pick(beads.value.map(({ label }) => label), false);
    else if (event.ctrlKey || event.metaKey) return;
    else if (/^[np]$/i.test(event.key) && !event.altKey && all.length) choose(all[now < 0 ? Math.max(0, all.findIndex(({ key: each }) => each === `bead ${selected.value}`)) : (now + (event.key.toLowerCase() === "n" ? 1 : all.length - 1)) % all.length]);
    else if (way && now >= 0) {
      const { turn, position, what, step, to } = all[now], by = NUDGE(event);
      const shift = add(viewer.right.map((v) => v * way[0] * by), viewer.up, way[1] * by);
      const edits = turn ? aiming(turn, way[0] ? aimed(turn, way[0] * by) : tilted(turn, way[1] * by)) : step ? step(shift) : to(add(position, shift), sight());
      if (edits) edit(edits, what, PRESSES);
      told();
    } else return;
    stop(event);
  };

  const mark = (context: CanvasRenderingContext2D, at: Pixel, radius: number, colour: string, dash: number[] = []) => {
    context.beginPath();
    context.arc(...at, radius, 0, 2 * Math.PI);
    context.strokeStyle = colour;
    context.lineWidth = 2;
    context.setLineDash(dash);
    context.stroke();
    context.setLineDash([]);
  };
  viewer.over = (context) => {
    for (const { label, position } of beads.value) {
      if (wrong.value.has(label)) mark(context, viewer.page(position), 7, "#b3261e");
      if (picked.value.includes(label)) mark(context, viewer.page(position), 9, "#222222");
    }
    for (const { key: own, position, turn } of handles(viewer)) {
      const at = viewer.page(position), active = own === hand.value;
      if (turn) {
        const start = held?.handle.key === own ? held.handle : null, span = start || active ? 180 : 14;
        context.beginPath();
        for (let angle = -span; angle <= span; angle += 2) context.lineTo(...viewer.page(arc(start?.turn ?? turn, start?.position ?? position, angle)));
        context.strokeStyle = active ? "#0b5394" : "#6b7780";
        context.lineWidth = 1.4;
        context.stroke();
        mark(context, start ? viewer.page(arc(start.turn!, start.position, held!.angle)) : at, 6, active ? "#0b5394" : "#6b7780");
      } else if (active && labelOf(own) === null) mark(context, at, 10, "#0b5394");
      if (own === HAND_EYE) {
        mark(context, at, 5, "#6b3fa0", [3, 2]);
        context.fillStyle = "#6b3fa0";
        context.fillText("hand-eye", at[0] + 9, at[1] + 4);
      }
    }
    if (!band) return;
    context.fillStyle = "rgba(11, 83, 148, 0.12)";
    context.strokeStyle = "#0b5394";
    const box = [band.from[0], band.from[1], band.to[0] - band.from[0], band.to[1] - band.from[1]] as const;
    context.fillRect(...box);
    context.strokeRect(...box);
  };
  viewer.under = (context) => {
    if (surface.value) shade(viewer, context, surface.value.mesh);
  };
  const listeners: [string, EventListener][] = [["pointerdown", down as EventListener], ["pointermove", move as EventListener], ["pointerup", up as EventListener], ["pointercancel", cancel], ["keydown", key as EventListener]];
  for (const [name, listener] of listeners) figure.addEventListener(name, listener, true);
  const blur = () => (hand.value = null);
  canvas.addEventListener("blur", blur);
  const leave = () => (pointed.value = null);
  canvas.addEventListener("pointerleave", leave);
  return () => {
    for (const [name, listener] of listeners) figure.removeEventListener(name, listener, true);
    canvas.removeEventListener("blur", blur);
    canvas.removeEventListener("pointerleave", leave);
  };
}

let kept: { key: string; mesh: Mesh; sheet: OffscreenCanvas } | null = null; // while only beads move

function shade({ right, up, scale, centre, ...viewer }: Viewer, context: CanvasRenderingContext2D, mesh: Mesh): void {
  const seen = { right, up, scale, centre, width: Math.round(viewer.width), height: Math.round(viewer.height) }, key = JSON.stringify(seen);
  if (kept?.key !== key || kept.mesh !== mesh) {
    kept = { key, mesh, sheet: new OffscreenCanvas(seen.width, seen.height) };
    kept.sheet.getContext("2d")!.putImageData(new ImageData(picture(mesh, seen), seen.width, seen.height), 0, 0);
  }
  context.drawImage(kept.sheet, 0, 0);
}
