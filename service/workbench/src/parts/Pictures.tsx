// The X-ray images and the three elevations: beads, targets, borders; beads are dragged, or moved with the keyboard.

import { computed, effect, signal } from "@preact/signals";
import { useLayoutEffect, useRef, useState } from "preact/hooks";
import { answer, current, drawn, late, layout, refused } from "../api";
import { adding, type Bead, beads, beadsOf, called, movingTo, pick, stopped, toggle as togglePicked, wrong } from "../beads";
import { add, length, moveInImage, pixelDirections, type Pixel, type Projection, project, roundStep, type Vector } from "../geometry";
import { cancelGesture, design, edit, finishGesture, gesture, type Json, opened, parse, picked, pointed, position, PRESSES, preview, say, selected, settled, steps, text, versions } from "../state";
import { brief } from "../words";
import { NUDGE } from "./grip";
import { hinted } from "./Minute";
import { saidOf } from "./Pin";
import { Arrows, Contours, heatOf, PlaceLegend, usePatch, worthOf, Worthy } from "./Places";
import { Remarks } from "./Problems";
import type { Scene } from "./hands";

export { type Bead, beads } from "../beads";

export const ghost = signal<string | null>(null); // name of the version that is drawn below
const ghosts = computed<Bead[]>(() => {
  const version = versions.value.find((v) => v.name === ghost.value);
  return version ? beadsOf(parse(version.text).data) : [];
});

/** Where beads were that a change has moved: at the grab while one is dragged, then in the step before. */
const moved = computed<Bead[]>(() => {
  const source = gesture.value.length ? text.value : steps.value[position.value - 1]?.text;
  if (source === undefined) return [];
  const now = new Map(beads.value.map((bead) => [bead.label, bead.position]));
  return beadsOf(gesture.value.length ? settled.value : parse(source).data).filter(({ label, position: was }) => now.has(label) && now.get(label)!.some((v, k) => v !== was[k]));
});

const targets = computed<{ name: string; position: Vector }[]>(() =>
  (layout.value?.targets ?? []).map((target) => ({ name: target.label, position: target.position_mm as Vector })));

/** Planned ones, wherever they are stated: what each is called, from where to where. */
const trajectories = computed(() => ((layout.value?.scene as Scene | null | undefined)?.items ?? []).filter(({ look }) => look === "trajectory"));

/** Whether what the service drew is of a design that differs in these parts; half-widths and noise move nothing. */
function outdated(parts: RegExp): boolean {
  if (drawn.value === design.value) return false;
  const only = (data: Json) => JSON.stringify(data ?? {}, (name, value) => (/^(tolerances|manufacturing|.*noise.*|half_width.*)$/.test(name) ? undefined : value));
  const picked = (data: Json) => only(Object.fromEntries(Object.entries(data ?? {}).filter(([name]) => parts.test(name))));
  return picked(drawn.value) !== picked(design.value);
}

const where = (p: readonly number[]) => ["x", "y", "z"].map((axis, k) => `${axis} ${p[k].toFixed(2)}`).join(", ").replace(/-/g, "−");

// --- a picture, whatever maps points to it ------------------------------------------------------------------------

export type Box = [number, number, number, number]; // left, top, width, height in units of the picture

export interface Plane {
  name: string;
  unit: string;
  box: Box; // what there is to see
  whole: Box; // how far it is zoomed out
  to(point: readonly number[]): Pixel | null;
  target(point: readonly number[]): Pixel | null; // the same for what does not sit on the structure
  from(point: readonly number[], at: Pixel): Vector; // the point moved to a place of the picture
  steps(point: readonly number[]): [Vector, Vector]; // directions in con for one mm right and one mm down
  frame?: Box;
  margin?: number;
  sees?: string[]; // labels of the beads that the view's estimate uses; absent: all
  closest?: string[]; // labels of the two beads whose images are nearest to each other
  axes?: [string, string];
  old: boolean; // drawn by what the service said of another design
}

const REACH = 12, MARK = 6, STILL = 3; // of a press on a bead, of its mark, and of a press that moves nothing: in pixels of a picture

/** What was zoomed to by hand in each picture, by its name; absent: what there is to see. */
const zooms = signal<Readonly<Record<string, Box | undefined>>>({});
const zoomTo = (name: string, box?: Box) => (zooms.value = { ...zooms.value, [name]: box });
effect(() => {
  opened.value; // another design has other beads
  zooms.value = {};
});
const ZOOM = 1.25, DEEPEST = 200; // of a key, and of all

function Picture({ plane, words }: { plane: Plane; words: string }) {
  const svg = useRef<SVGSVGElement>(null);
  const held = useRef<{ bead: Bead; from: Pixel; at: Pixel; moved: boolean; again: boolean; more: boolean; box: Box } | null>(null);
  const slid = useRef<{ from: Pixel; box: Box } | null>(null); // where the ground was pressed, in pixels of the screen
  const [band, stretch] = useState<{ from: Pixel; to: Pixel; more: boolean } | null>(null); // round what is to be chosen
  const pinched = useRef<{ spread: number; middle: Pixel; box: Box } | null>(null); // by two fingers
  const pressed = useRef<Pixel | null>(null); // where the last press was, if nothing was moved by it
  const [watched, watch] = useState(false); // whether it has the focus
  const [hovered, hover] = useState<string | null>(null); // here; in any picture it is pointed at
  const point = (label: string | null) => {
    hover(label);
    pointed.value = label;
  };
  const zoomed = zooms.value[plane.name], box = held.current?.box ?? zoomed ?? plane.box; // it stands still while a bead is dragged
  const [left, top, width, height] = box;
  const [wide, measure] = useState(300), scale = width / wide; // of a pixel of the screen: marks and words are as large in every picture
  useLayoutEffect(() => {
    const observer = new ResizeObserver(() => svg.current?.clientWidth && measure(svg.current.clientWidth));
    observer.observe(svg.current!);
    return () => observer.disconnect();
  }, []);
  const placed = beads.value.map((bead) => ({ bead, at: plane.to(bead.position) }));
  const inside = ([x, y]: Pixel): Pixel => { // what is beyond the picture stands at its edge, what was zoomed away does not
    const [l, t, w, h] = zoomed ? plane.whole : box;
    return [Math.min(Math.max(x, l + 6 * scale), l + w - 6 * scale), Math.min(Math.max(y, t + 6 * scale), t + h - 6 * scale)];
  };
  const chosen = placed.find(({ bead }) => bead.label === selected.value) ?? placed[0];
  const patch = usePatch(plane, chosen?.bead, box, watched && selected.value !== null);

  const place = (at: { clientX: number; clientY: number }): Pixel => {
    const matrix = svg.current!.getScreenCTM()!.inverse();
    const p = new DOMPoint(at.clientX, at.clientY).matrixTransform(matrix);
    return [p.x, p.y];
  };
  /** Larger by a factor about a place, where that is shown now, from what was shown. */
  const zoom = (factor: number, [x, y]: Pixel, [l, t, w, h]: Box = box) => {
    const [, , most] = plane.whole, wide = Math.min(Math.max(w / factor, most / DEEPEST), most), f = wide / w;
    zoomTo(plane.name, wide < most ? [x - f * (x - l), y - f * (y - t), wide, f * h] : plane.whole);
  };
  const pinch = (event: TouchEvent) => {
    if (event.touches.length !== 2) return void (pinched.current = null);
    if (event.cancelable) event.preventDefault();
    const [a, b] = event.touches, spread = Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY), middle: Pixel = [(a.clientX + b.clientX) / 2, (a.clientY + b.clientY) / 2];
    if (!pinched.current) {
      held.current = null;
      cancelGesture();
      pinched.current = { spread, middle, box };
    } else {
      const { spread: was, middle: from, box: [l, t, w, h] } = pinched.current, { left: x, top: y } = svg.current!.getBoundingClientRect(), per = w / wide;
      const about: Pixel = [l + (from[0] - x) * per, t + (from[1] - y) * per];
      zoom(spread / Math.max(was, 1), about, [l - (middle[0] - from[0]) * per, t - (middle[1] - from[1]) * per, w, h]);
    }
  };
  const near = (a: Pixel, b: Pixel, most: number) => Math.hypot(a[0] - b[0], a[1] - b[1]) <= most * scale;
  /** The beads that a press takes, the nearest mark first; where marks lie over one another, all of them. */
  const reached = (now: Pixel) => {
    const found = placed.flatMap(({ bead, at }) => (at ? [{ bead, at: inside(at), true_: at }] : [])).filter(({ at }) => near(at, now, REACH));
    const far = ({ at }: { at: Pixel }) => Math.hypot(at[0] - now[0], at[1] - now[1]);
    found.sort((a, b) => far(a) - far(b));
    return found.filter((each, k) => k === 0 || near(each.at, now, MARK));
  };
  /** What a press takes: the nearest; where the last press was, and moved nothing, the one that is chosen. */
  const taken = (now: Pixel) => {
    const under = reached(now), again = pressed.current !== null && near(pressed.current, now, STILL);
    const same = again ? under.find(({ bead }) => bead.label === selected.value) : undefined;
    return { under, found: same ?? under[0], again: same !== undefined };
  };
  const choose = (label: string) => {
    if (picked.value.includes(label)) pick([label], true); // and what is chosen with it
    else selected.value = label;
    svg.current!.focus({ preventScroll: true });
  };
  const grab = (event: PointerEvent) => {
    const now = place(event), { found, again } = taken(now), more = event.shiftKey || adding.value;
    if (event.button || !event.isPrimary) return;
    if (!found) {
      if (more || event.ctrlKey || event.metaKey) stretch({ from: now, to: now, more });
      else if (event.pointerType === "touch") return; // which scrolls the page
      else slid.current = { from: [event.clientX, event.clientY], box };
      return void svg.current!.setPointerCapture(event.pointerId);
    }
    // A finger scrolls the page, unless it is on a bead that was chosen before
    const free = event.pointerType === "touch" && !picked.value.includes(found.bead.label);
    held.current = { bead: found.bead, from: now, at: found.true_, moved: false, again, more, box: plane.box };
    if (free) return;
    event.preventDefault();
    if (!more) choose(found.bead.label);
    svg.current!.setPointerCapture(event.pointerId);
  };
  const move = (event: PointerEvent) => {
    const now = place(event);
    if (band) return stretch({ ...band, to: now });
    if (slid.current) {
      const { from, box: [l, t, w, h] } = slid.current, x = event.clientX - from[0], y = event.clientY - from[1];
      return void (Math.hypot(x, y) > STILL && zoomTo(plane.name, [l - x * scale, t - y * scale, w, h]));
    }
    if (!held.current) return point(event.pointerType === "touch" ? null : taken(now).found?.bead.label ?? null);
    const { bead, from, at, more } = held.current, begins = !held.current.moved;
    held.current.moved ||= !near(from, now, STILL);
    if (held.current.moved && begins && more) pick([bead.label], true);
    if (!held.current.moved || !picked.value.includes(bead.label)) return;
    const edits = movingTo(bead.label, plane.from(bead.position, [at[0] + now[0] - from[0], at[1] + now[1] - from[1]]));
    if (edits) preview(edits);
  };
  const drop = () => {
    const press = held.current;
    held.current = slid.current = null;
    if (band) {
      const [[l, r], [t, b]] = [0, 1].map((k) => [Math.min(band.from[k], band.to[k]), Math.max(band.from[k], band.to[k])]);
      pick(placed.filter(({ at }) => at && at[0] >= l && at[0] <= r && at[1] >= t && at[1] <= b).map(({ bead }) => bead.label), band.more);
      svg.current!.focus({ preventScroll: true });
      return stretch(null);
    }
    if (!press) return;
    if (press.moved) {
      pressed.current = null;
      finishGesture(`Move ${called(press.bead.label)}`);
      return told();
    }
    if (press.more) {
      togglePicked(press.bead.label);
      return svg.current!.focus({ preventScroll: true });
    }
    const under = reached(press.from), k = under.findIndex(({ bead }) => bead.label === press.bead.label);
    const next = press.again && k >= 0 ? under[(k + 1) % under.length].bead : press.bead;
    pressed.current = press.from;
    selected.value = next.label;
    svg.current!.focus({ preventScroll: true });
    point(next.label);
  };
  const told = () => {
    if (stopped.value) say(`It stays: there it would be ${stopped.value}. "Arrange" has what is kept.`);
    stopped.value = null;
  };
  const press = (event: KeyboardEvent) => {
    const arrows: Record<string, [number, number]> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const way = arrows[event.key];
    if (event.key === "Escape") {
      stretch(null);
      if (!held.current && !gesture.value.length) selected.value = null;
      held.current = null;
      cancelGesture();
    } else if (event.key.toLowerCase() === "a" && (event.ctrlKey || event.metaKey)) pick(placed.map(({ bead }) => bead.label), false);
    else if (way && chosen && !event.ctrlKey && !event.metaKey) {
      const [right, down] = plane.steps(chosen.bead.position), by = NUDGE(event);
      const moved = add(add(chosen.bead.position, right, way[0] * by), down, way[1] * by);
      const edits = movingTo(chosen.bead.label, moved);
      if (edits) edit(edits, `Move ${called(chosen.bead.label)}`, PRESSES);
      told();
    } else if (/^[np]$/i.test(event.key) && !event.ctrlKey && !event.metaKey && !event.altKey && placed.length) {
      const k = placed.indexOf(chosen!), next = (k + (event.key.toLowerCase() === "n" ? 1 : placed.length - 1)) % placed.length;
      selected.value = placed[selected.value ? next : 0].bead.label;
      const at = placed[selected.value ? next : 0].at;
      if (at && isOutside(at, box)) zoomTo(plane.name);
    } else if (/^[-−+=0]$/.test(event.key) && !event.ctrlKey && !event.metaKey) {
      if (event.key === "0") zoomTo(plane.name);
      else zoom(/[+=]/.test(event.key) ? ZOOM : 1 / ZOOM, chosen?.at ?? [left + width / 2, top + height / 2]);
    } else return;
    event.preventDefault();
  };

  const outside = (at: Pixel) => plane.frame !== undefined && isOutside(at, plane.frame);
  const [first, second] = (plane.closest ?? []).map((label) => placed.find(({ bead }) => bead.label === label)?.at);
  const crowded = placed.length > 24, names = crowded ? [] : placeLabels(placed.map(({ bead, at }) => at && { at: inside(at), words: clip(bead.label) }), [left, top, width, height], scale);
  const bar = roundStep(width / 4);
  const over = placed.find(({ bead, at }) => at && bead.label === hovered);
  const below = over ? reached(inside(over.at!)).map(({ bead }) => bead.label).filter((label) => label !== hovered) : [];
  // What is pointed at, and what is chosen, are drawn above their neighbours
  const rank = (label: string) => (label === pointed.value ? 2 : picked.value.includes(label) ? 1 : 0);
  const ordered = placed.map((each, k) => ({ ...each, k })).sort((a, b) => rank(a.bead.label) - rank(b.bead.label));
  return (
    <figure class={plane.old ? "picture old" : "picture"}>
      <figcaption>
        <span>{plane.name}</span>
        <button type="button" class={zoomed || plane.whole !== plane.box ? "small" : "small unseen"} disabled={!zoomed && plane.whole === plane.box} onClick={() => zoomTo(plane.name, zoomed ? undefined : plane.whole)}>{zoomed ? "Fit" : "Whole image"}</button>
      </figcaption>
      <svg
        ref={svg} viewBox={`${left} ${top} ${width} ${height}`} tabindex={0} role="application" class={hovered ? "movable over" : "movable"}
        aria-label={`${words} ${chosen ? `Chosen: ${chosen.bead.label} at ${where(chosen.bead.position)} mm${worthOf(chosen.bead.label)}${picked.value.length > 1 ? `, and ${picked.value.length - 1} more` : ""}.` : "No bead."} Arrow keys move it by 1 mm, with Shift by 10, with Alt by 0.1; N and P choose the next and the one before, Ctrl+A all; + and − zoom, 0 fits.`}
        onPointerDown={grab} onPointerMove={move} onPointerUp={drop} onFocus={() => watch(true)} onBlur={() => watch(false)} onPointerLeave={() => point(null)} onPointerCancel={() => { held.current = slid.current = null; stretch(null); cancelGesture(); }} onKeyDown={press}
        onTouchStart={(event) => { pinch(event); if (band || (held.current && picked.value.includes(held.current.bead.label))) event.preventDefault(); }} onTouchMove={pinch} onTouchEnd={pinch}
        onWheel={(event) => {
          if (document.activeElement !== svg.current && !event.ctrlKey) return; // the page scrolls on
          event.preventDefault();
          zoom(Math.exp(-Math.min(Math.max(event.deltaY * (event.deltaMode === 1 ? 16 : 1), -120), 120) / 400), place(event));
        }}
      >
        {over && <title>{`${over.bead.label}: ${where(over.bead.position)} mm${plane.unit === "px" ? `; u ${over.at![0].toFixed(1)}, v ${over.at![1].toFixed(1)} px` : ""}${worthOf(over.bead.label)}${saidOf(over.bead.label).map(({ text }) => `; said: ${text}`).join("")}${wrong.value.has(over.bead.label) ? `; ${wrong.value.get(over.bead.label)}` : ""}${below.length ? `. Below it ${below.join(", ")}: press twice without moving` : ""}`}</title>}
        <rect class="ground" x={left} y={top} width={width} height={height} />
        {plane.frame && <rect class="detector" x={plane.frame[0]} y={plane.frame[1]} width={plane.frame[2]} height={plane.frame[3]} />}
        {plane.frame && plane.margin ? (
          <rect class="margin" x={plane.frame[0] + plane.margin} y={plane.frame[1] + plane.margin}
            width={plane.frame[2] - 2 * plane.margin} height={plane.frame[3] - 2 * plane.margin} />
        ) : null}
        {patch && <Contours patch={patch} scale={scale} />}
        <Worthy plane={plane} scale={scale} />
        {first && second && <path class="closest" d={`M${first[0]} ${first[1]}L${second[0]} ${second[1]}`} />}
        {ghosts.value.map((old) => {
          const at = plane.to(old.position);
          return at && <circle key={`old ${old.index}`} class="ghost" cx={at[0]} cy={at[1]} r={5 * scale} />;
        })}
        {moved.value.map((old) => {
          const was = plane.to(old.position), bead = beads.value.find(({ label }) => label === old.label), now = bead && plane.to(bead.position);
          return was && now && <g key={`was ${old.label}`} class="was">{moved.value.length < 4 && <path d={`M${was[0]} ${was[1]}L${now[0]} ${now[1]}`} />}<circle cx={was[0]} cy={was[1]} r={5 * scale} /></g>;
        })}
        {trajectories.value.map(({ title, points: [from, to] }) => {
          const [a, b] = [plane.target(from), plane.target(to)];
          return a && b && <path key={title} class="planned" d={`M${a.join(" ")}L${b.join(" ")}`}><title>{`planned ${title}`}</title></path>;
        })}
        {targets.value.slice(0, 200).map((target) => {
          const at = plane.target(target.position), r = 6 * scale;
          return at && (
            <g key={`target ${target.name}`} class="target">
              <title>{`target ${target.name}: ${where(target.position)} mm`}</title>
              <path d={`M${at[0] - r} ${at[1] - r}l${2 * r} ${2 * r}M${at[0] + r} ${at[1] - r}l${-2 * r} ${2 * r}`} />
              {targets.value.length <= 8 && <text x={at[0] + 8 * scale} y={at[1] + 4 * scale} font-size={12 * scale}>{clip(target.name)}</text>}
            </g>
          );
        })}
        <Arrows plane={plane} scale={scale} />
        {ordered.map(({ bead, at, k }) => {
          if (!at) return null;
          const [x, y] = inside(at), name = names[k] ?? { x: 8 * scale, y: -5 * scale, end: false, hidden: Number(crowded) }, isChosen = picked.value.includes(bead.label), bad = outside(at) || wrong.value.has(bead.label), over = bead.label === pointed.value;
          const heat = heatOf(bead.label), named = isChosen || over || hinted.value === bead.label || name.hidden === 0;
          return (
            <g key={bead.index} data-bead={bead.label} class={`bead${isChosen ? " chosen" : ""}${over ? " over" : ""}${bad ? " outside" : ""}${plane.sees && !plane.sees.includes(bead.label) ? " unseen" : ""}`}>
              <circle class="reach" cx={x} cy={y} r={REACH * scale} />
              {hinted.value === bead.label && <circle class="hint" cx={x} cy={y} r={11 * scale} />}
              {saidOf(bead.label).length > 0 && <path class="pin" d={`M${x + 3 * scale} ${y - 3 * scale}v${-9 * scale}h${11 * scale}v${7 * scale}h${-8 * scale}z`} />}
              <circle class="mark" cx={x} cy={y} r={4.5 * scale} style={heat === null || bad ? undefined : { fill: `color-mix(in oklab, var(--heat) ${Math.round(100 * heat)}%, var(--bead))` }} />
              {named && <text x={x + name.x} y={y + name.y} font-size={12 * scale} text-anchor={name.end ? "end" : "start"}>{clip(bead.label)}</text>}
            </g>
          );
        })}
        {band && <rect class="band" x={Math.min(band.from[0], band.to[0])} y={Math.min(band.from[1], band.to[1])} width={Math.abs(band.to[0] - band.from[0])} height={Math.abs(band.to[1] - band.from[1])} />}
        <g class="scale" aria-hidden="true">
          <path d={`M${left + 12 * scale} ${top + height - 10 * scale}h${bar}`} />
          <text x={left + 12 * scale} y={top + height - 14 * scale} font-size={11 * scale}>{`${bar} ${plane.unit}`}</text>
          {plane.axes && <text x={left + 8 * scale} y={top + 15 * scale} font-size={11 * scale}>{`→ ${plane.axes[0]}   ↑ ${plane.axes[1]}`}</text>}
        </g>
      </svg>
    </figure>
  );
}

/** Where each name stands beside its bead: at the first of four places in the picture where it hides no bead or name. */
function placeLabels(beads: ({ at: Pixel; words: string } | null)[], [left, top, width, height]: Box, scale: number) {
  const marks = beads.flatMap((bead) => (bead ? [bead.at] : [])), taken: number[][] = [];
  return beads.map((bead) => {
    if (!bead) return null;
    const [x, y] = bead.at, wide = 7.2 * scale * bead.words.length;
    const places = [[8, -5], [8, 13], [-8, -5], [-8, 13]].map(([right, down]) => {
      const [x0, y1] = [x + scale * right - (right < 0 ? wide : 0), y + scale * down], box = [x0, y1 - 10 * scale, x0 + wide, y1];
      const hidden = marks.filter((m) => m !== bead.at && m[0] > box[0] - 4 * scale && m[0] < box[2] + 4 * scale && m[1] > box[1] - 4 * scale && m[1] < box[3] + 4 * scale).length
        + taken.filter((t) => t[0] < box[2] && t[2] > box[0] && t[1] < box[3] && t[3] > box[1]).length
        + Number(box[0] < left || box[1] < top || box[2] > left + width || box[3] > top + height);
      return { x: scale * right, y: scale * down, end: right < 0, box, hidden };
    });
    const best = places.reduce((a, b) => (b.hidden < a.hidden ? b : a));
    if (!best.hidden) taken.push(best.box); // what is not written takes no place
    return best;
  });
}

const enlarged = signal<ReadonlySet<string>>(new Set()); // views whose picture is as wide as there is room

function toggle(view: string): void {
  const next = new Set(enlarged.value);
  if (!next.delete(view)) next.add(view);
  enlarged.value = next;
}

/** The part of an image with beads and targets, in steps, so that it stands still while a bead is dragged; all of it,
 * where that is hardly more. */
function part(P: Projection, targets_: Projection, whole: Box, frame?: Box): Box {
  const seen = [...beads.value.map((b) => project(P, b.position)), ...targets.value.map((t) => project(targets_, t.position))]
    .filter((p): p is Pixel => p !== null && !(frame && isOutside(p, frame)));
  if (seen.length < 2) return whole;
  const ends = [0, 1].map((k) => [Math.min(...seen.map((p) => p[k])), Math.max(...seen.map((p) => p[k]))]), step = whole[2] / 20;
  const side = step * Math.ceil((1.3 * Math.max(...ends.map(([low, high]) => high - low))) / step);
  const [x, y] = ends.map(([low, high]) => (step / 2) * Math.round((low + high) / step) - side / 2);
  return side < 0.9 * Math.min(whole[2], whole[3]) ? [x, y, side, side] : whole;
}

const isOutside = ([x, y]: Pixel, [l, t, w, h]: Box) => x < l || y < t || x > l + w || y > t + h;

const clip = (label: string) => (label.length > 18 ? `${label.slice(0, 17)}…` : label);

// --- which pictures there are ---------------------------------------------------------------------------------------

export function Images() {
  const views = layout.value?.views ?? [], old = outdated(/^(views|interfaces|transforms|targets|temperature|execution|estimation|model)$/);
  const checks = new Map((answer.value?.score.views ?? []).map((view) => [view.view, view]));
  return (
    <>
    <div class="pictures" role="group" aria-label="X-ray images">
      {views.map((view, k) => {
        const P = view.projection as Projection, check = checks.get(view.view);
        const [width, height] = view.image_size_px ?? extent(P);
        const large = enlarged.value.has(view.view), frame: Box | undefined = view.image_size_px ? [0, 0, width, height] : undefined;
        const whole: Box = [-0.02 * width, -0.02 * height, 1.04 * width, 1.04 * height];
        const plane: Plane = {
          name: `${view.view}: X-ray image`, unit: "px",
          box: part(P, view.target_projection as Projection, whole, frame), whole, old, frame, margin: view.margin_px,
          to: (point) => project(P, point), sees: design.value?.views?.[k]?.sees, closest: current.value ? check?.closest_pair : undefined,
          target: (point) => project(view.target_projection as Projection, point),
          from: (point, at) => moveInImage(P, point, at),
          steps: (point) => pixelDirections(P, point).map((d) => d.map((v) => v / length(d)) as Vector) as [Vector, Vector],
        };
        const margin = check?.smallest_margin_px;
        return (
          <div key={view.view} class={large ? "large" : undefined}>
            <Picture plane={plane} words={`Image of view ${view.view}.`} />
            <div class="steady">
              <p class="note">
                <button type="button" class="small" aria-pressed={large} onClick={() => toggle(view.view)}>Enlarge</button>{" "}
                {check && !refused.value && (
                  <span class={late.value ? "old" : ""}>
                    {margin == null ? "" : `nearest to the edge ${brief(margin)} px; `}
                    {`closest pair ${check.closest_pair.join(" and ")}, ${brief(check.closest_pair_px)} px`}
                    {check.closest_pair_needs_px > 0 && (check.closest_pair_px < check.closest_pair_needs_px ? <strong class="bad">{` (to be told apart they need ${brief(check.closest_pair_needs_px)})`}</strong> : ` (needs ${brief(check.closest_pair_needs_px)})`)}
                  </span>
                )}
              </p>
              <Remarks at={`/views/${k}`} />
            </div>
          </div>
        );
      })}
    </div>
    <PlaceLegend />
    </>
  );
}

/** Where a view states no detector: what its beads and targets take. */
function extent(P: Projection): Pixel {
  const seen = [...beads.value.map((b) => b.position), ...targets.value.map((t) => t.position)].map((p) => project(P, p)).filter((p) => p !== null);
  return [Math.max(100, ...seen.map((p) => 1.2 * p[0])), Math.max(100, ...seen.map((p) => 1.2 * p[1]))];
}

const ELEVATIONS: [string, 0 | 1 | 2, 0 | 1 | 2][] = [["Front (x, z)", 0, 2], ["Side (y, z)", 1, 2], ["Top (x, y)", 0, 1]];

export function Elevations() {
  const all = [...beads.value.map((b) => b.position), ...targets.value.slice(0, 50).map((t) => t.position)];
  if (!all.length) return null;
  const old = outdated(/^targets$/);
  return (
    <>
    <div class="pictures three" role="group" aria-label="Elevations, frame con">
      {ELEVATIONS.map(([name, a, b]) => {
        const ends = (k: number) => [Math.min(...all.map((p) => p[k])), Math.max(...all.map((p) => p[k]))];
        const [[x0, x1], [y0, y1]] = [ends(a), ends(b)];
        // A box that changes in steps, so that it stands still while a bead is dragged
        const side = 20 * Math.ceil((Math.max(x1 - x0, y1 - y0) * 1.25 + 10) / 20);
        const centre = [10 * Math.round((x0 + x1) / 20), 10 * Math.round((y0 + y1) / 20)];
        const axis = (k: number, sign: number): Vector => [0, 1, 2].map((m) => (m === k ? sign : 0)) as Vector;
        const box: Box = [centre[0] - side / 2, -centre[1] - side / 2, side, side];
        const plane: Plane = {
          old, name, unit: "mm", box, whole: box, axes: ["xyz"[a], "xyz"[b]] as [string, string],
          to: (p) => [p[a], -p[b]],
          target: (p) => [p[a], -p[b]],
          from: (p, at) => p.map((value, k) => (k === a ? at[0] : k === b ? -at[1] : value)) as Vector,
          steps: () => [axis(a, 1), axis(b, -1)],
        };
        return <Picture key={name} plane={plane} words={`Elevation ${name}, frame con, mm.`} />;
      })}
    </div>
    <Remarks at="/fiducials" />
    </>
  );
}
