// What is changed by typing and sliding: beads, half-widths, noise, angles and distances of the views.

import { computed, effect, signal } from "@preact/signals";
import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";
import { type Line, placeOf } from "../advice";
import { answer, late, refused } from "../api";
import { cancelGesture, design, edit, finishGesture, type Json, opened, type Path, PRESSES, preview, selected, valueAt } from "../state";
import { decisive } from "../verdicts";
import { brief, mm, percent, readNumber } from "../words";
import { allowancesOf, slackOf } from "./Budget";
import { type Bead, beads } from "./Pictures";
import { Term } from "./Words";

/** Show a value in a field, unless something else is just being typed there. */
export function showValue(field: HTMLInputElement | null, value: Json): void {
  if (!field) return;
  const pending = document.activeElement === field && field.value !== field.defaultValue;
  field.defaultValue = value === undefined || value === null ? "" : String(value); // what undo looks at: see main.tsx
  if (!pending) field.value = field.defaultValue;
}

/** A number that is typed; it takes effect on Enter or when the field is left. */
export function NumberField({ path, label, unit, what, hidden = false }: { path: Path; label: string; unit: string; what?: string; hidden?: boolean }) {
  const field = useRef<HTMLInputElement>(null), value = valueAt(design.value, path), [wrong, setWrong] = useState<string | null>(null);
  useLayoutEffect(() => {
    showValue(field.current, value);
    setWrong(null);
  }, [value]);
  const take = () => {
    const text = field.current!.value, number = readNumber(text, unit);
    if (text.trim() === "") field.current!.value = String(value ?? "");
    setWrong(text.trim() !== "" && number === null ? text : null);
    if (text.trim() !== "" && number !== null) {
      if (number !== value) showAndEdit(() => edit([{ path, value: number }], what ?? `${label} ${number} ${unit}`.trim()));
      else field.current!.value = String(value);
    }
  };
  const showAndEdit = (change: () => void) => {
    field.current!.defaultValue = field.current!.value;
    change();
  };
  return (
    <>
    <label class="field">
      <span class={hidden ? "hidden" : ""}>{`${label}${unit ? `, ${unit}` : ""}`}</span>
      <input ref={field} type="text" inputMode="decimal" data-pointer={path.join("/")} onBlur={take} aria-invalid={wrong !== null} onInput={() => setWrong(null)}
        onKeyDown={(event) => { if (event.key === "Enter") take(); else if (event.key === "Escape") { event.currentTarget.value = String(value ?? ""); event.currentTarget.blur(); } }} />
    </label>
    {wrong !== null && <span class="wrong" role="alert">{`“${wrong.trim()}” is not a number${unit ? ` in ${unit}` : ""}; the design has ${value}`}</span>}
    </>
  );
}

/** A bead that is taken out is not in any view's list of those that it sees either. */
const losing = (bead: Bead) => [
  { path: ["fiducials", "points", bead.index], value: undefined },
  ...(design.value?.views ?? []).flatMap((view: Json, k: number) => view.sees?.includes(bead.label) ? [{ path: ["views", k, "sees"], value: view.sees.filter((label: string) => label !== bead.label) }] : []),
];

export function Beads() {
  const known = beads.value, points = design.value?.fiducials?.points;
  const list = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const row = list.current?.querySelector<HTMLElement>("tr.chosen"); // the list alone is scrolled to it, not the page
    if (row && (row.offsetTop < list.current!.scrollTop || row.offsetTop + row.offsetHeight > list.current!.scrollTop + list.current!.clientHeight)) list.current!.scrollTop = row.offsetTop - 60;
  }, [selected.value]);
  if (!Array.isArray(points)) return <p class="note">The fiducials of this design come from a file or a region: use "All fields" or the text.</p>;
  const addBead = () => {
    const near = known.find((b) => b.label === selected.value)?.position ?? [0, 0, 0];
    const used = new Set(known.map((b) => b.label));
    let n = known.length + 1;
    while (used.has(`F${n}`)) n += 1;
    const at = near.map((v, k) => Math.round(10 * (v + [12, 8, 10][k])) / 10);
    edit([{ path: ["fiducials", "points", points.length], value: { label: `F${n}`, position_mm: at } }], `Add F${n}`);
    selected.value = `F${n}`;
  };
  return (
    <>
      <div ref={list} class="scroll beads" tabIndex={0} role="region" aria-label="Fiducials">
        <table>
          <thead><tr><th>Bead</th><th class="number">x, mm</th><th class="number">y, mm</th><th class="number">z, mm</th><th><span class="hidden">Remove</span></th></tr></thead>
          <tbody>
            {known.map((bead) => (
              <tr key={bead.index} class={bead.label === selected.value ? "chosen" : ""} onClick={() => (selected.value = bead.label)}>
                <th>{bead.label}</th>
                {["x", "y", "z"].map((axis, k) => (
                  <td key={axis}><NumberField path={["fiducials", "points", bead.index, "position_mm", k]} label={`${bead.label} ${axis}`} unit="mm" what={`Move ${bead.label}`} hidden /></td>
                ))}
                <td><button type="button" class="small" aria-label={`Lose ${bead.label}: take it out`} title="Take it out (undo brings it back)"
                  onClick={() => edit(losing(bead), `Lose ${bead.label}`)}>×</button></td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
      <p><button type="button" onClick={addBead}>Add a bead</button></p>
    </>
  );
}

// --- half-widths ---------------------------------------------------------------------------------------------------

interface Slide {
  path: Path;
  label: string;
  unit: string;
  grades: number[];
}

const UNIT = /_(mm|deg|px|n|k|mm_per_n|rel)$/;

/** Every half-width and standard deviation of the design, wherever it stands. */
function slides(data: Json): Slide[] {
  const found: Slide[] = [];
  const visit = (part: Json, path: Path, words: string[]) => {
    if (part === null || typeof part !== "object") return;
    for (const [name, value] of Object.entries(part)) {
      const at = [...path, Array.isArray(part) ? Number(name) : name];
      if (typeof value === "number" && /^(half_width|std|fiducial_noise|target_noise)/.test(name) && UNIT.test(name)) {
        const what = /noise/.test(name) ? [name.replace(/_px$/, "").replace(/_/g, " ")] : [];
        found.push({ path: at, label: [...words, ...what].join(", "), unit: UNIT.exec(name)![1].replace("deg", "°").replace("rel", "(1)").replace(/^k$/, "K"), grades: [] });
      } else if (name === "half_widths_px" && Array.isArray(value)) {
        value.forEach((_, degree) => found.push({ path: [...at, degree], label: [...words, `field of degree ${degree}`].join(", "), unit: "px", grades: [] }));
      } else if (value && typeof value === "object" && name !== "optimise" && name !== "requirements") {
        const item = Array.isArray(part) ? (value as Json).name ?? (value as Json).label ?? name : (value as Json).label ? `${name.replace(/_/g, " ")} (${(value as Json).label})` : name.replace(/_/g, " ");
        visit(value, at, name === "tolerances" || name === "interfaces" ? words : [...words, item]);
      }
    }
  };
  const first = ["interfaces", "fiducials", "views", "temperature", "execution"], others = Object.keys(data ?? {}).filter((name) => !first.includes(name));
  for (const part of [...first, ...others].filter((name) => name !== "optimise" && name !== "requirements")) visit(data?.[part], [part], part === "interfaces" || part === "views" ? [] : [part]);
  return found;
}

type Range = [number, number];
/** Of the slider, in the field's unit; what is typed may be beyond. */
const rangeOf = (unit: string): Range => unit === "(1)" ? [1e-5, 0.1] : [1e-3, 10];
const toSlider = (value: number, [low, high]: Range) => Math.round(1000 * (Math.log(Math.max(value, low) / low) / Math.log(high / low)));
const fromSlider = (at: number, [low, high]: Range) => Number((low * (high / low) ** (at / 1000)).toPrecision(2));

/** So many steps in the second digit from a value. */
function nudge(value: number, steps: number, [low, high]: Range): number {
  const step = 10 ** (Math.floor(Math.log10(Math.max(value, low))) - 1);
  return Math.min(Math.max(high, value), Math.max(low, Number((value + steps * step).toPrecision(2))));
}

/** Half-widths of the process grades that the design lists for this very tolerance: the slider stops at them. */
function gradesOf(data: Json, path: Path): number[] {
  const [, interface_, , part, name] = path, component = valueAt(data, path.slice(0, -1))?.name ?? part;
  const free: Json[] = Array.isArray(data?.optimise?.tolerances) ? data.optimise.tolerances : [];
  const own = free.find((tolerance) => tolerance?.interface === interface_ && tolerance?.component === component);
  return (own?.grades ?? []).map((grade: Json) => grade[name]).filter((width: unknown) => typeof width === "number" && width > 0);
}

/** The lines of the budget by the place of their half-width, at the target that decides. */
const lines = computed<{ target: string; at: Map<string, Line> }>(() => {
  const score = answer.value?.score, data = answer.value?.design;
  const target = score && (score.targets.find(({ name }) => name === decisive(score.verdict.checks)?.target) ?? score.targets[0]), at = new Map<string, Line>();
  for (const line of target?.contributors ?? []) {
    const path = placeOf(data, line);
    if (path) at.set(path.join("/"), line);
  }
  return { target: target?.name ?? "", at };
});

/** The order of the rows: by share, as it was when the design was opened or when it was asked for; what is changed stays
 * where it is. */
const order = signal<Map<string, number>>(new Map());
const sort = () => (order.value = new Map([...lines.peek().at].map(([place, line]) => [place, line.variance_share])));
let sorted = -1; // which design that was opened
effect(() => {
  if (!answer.value || sorted === opened.value) return;
  sorted = opened.value;
  sort();
});

export function HalfWidths() {
  const data = design.value, list = slides(data), groups = new Map<string, Slide[]>(), share = ({ path }: Slide) => order.value.get(path.join("/")) ?? -1;
  for (const slide of list) {
    const group = slide.path.slice(0, slide.path[0] === "interfaces" || slide.path[0] === "views" ? 2 : 1).join(".");
    groups.set(group, [...(groups.get(group) ?? []), { ...slide, grades: gradesOf(data, slide.path) }]);
  }
  const of = (members: Slide[]) => members.reduce((sum, slide) => sum + Math.max(0, share(slide)), 0);
  const ranked = [...groups].map(([group, members]) => [group, [...members].sort((a, b) => share(b) - share(a))] as const).sort(([, a], [, b]) => of(b) - of(a));
  const { target, at } = lines.value, allowances = answer.value ? allowancesOf(answer.value.score) : null;
  return (
    <div class={late.value || refused.value ? "slides outdated" : "slides"}>
      {at.size > 0 && (
        <div class="slideheads">
          <span>{`At ${target}, sorted by share `}<button type="button" class="small" onClick={sort}>Sort again</button></span>
          <Term word="share">Share</Term><span>P95 without, mm</span>
        </div>
      )}
      {ranked.map(([group, members]) => (
        <fieldset key={group}>
          <legend>{groupName(data, members[0].path)}</legend>
          {members.map((slide) => {
            const line = at.get(slide.path.join("/"));
            return <Slider key={slide.path.join("/")} slide={slide} line={line} slack={line && slackOf(allowances?.find((each) => each.target === target && each.contributor === line.name && each.component === line.component))} />;
          })}
        </fieldset>
      ))}
    </div>
  );
}

function groupName(data: Json, path: Path): string {
  if (path[0] === "views") return `View ${valueAt(data, path.slice(0, 2))?.name ?? path[1]}`;
  if (path[0] === "interfaces") {
    const label = valueAt(data, path.slice(0, 2))?.label;
    return `${String(path[1]).replace(/_/g, " to ")}${label ? `: ${label}` : ""}`;
  }
  return path[0].toString().replace(/^./, (letter) => letter.toUpperCase());
}

function Slider({ slide, line, slack }: { slide: Slide; line?: Line; slack?: string }) {
  const value = valueAt(design.value, slide.path) as number, name = String(slide.path[slide.path.length - 2] ?? "");
  const range = rangeOf(slide.unit), short = /^[rt][xyz]$/.test(name) ? name : slide.label.split(", ").slice(-1)[0];
  const marks = `grades ${slide.path.join(" ")}`.replace(/\W+/g, "-");
  const slideTo = (at: number) => {
    let next = fromSlider(at, range);
    const near = slide.grades.find((grade) => Math.abs(toSlider(grade, range) - at) < 12);
    if (near !== undefined) next = near;
    preview([{ path: slide.path, value: next }]);
  };
  return (
    <div class="slide">
      <span class="name">{short}</span>
      <input type="range" min={0} max={1000} step={1} value={toSlider(value, range)} list={slide.grades.length ? marks : undefined}
        aria-label={`${slide.label}: half-width`} aria-valuetext={`${brief(value)} ${slide.unit}`}
        onInput={(event) => slideTo(event.currentTarget.valueAsNumber)} onChange={() => finishGesture(`${slide.label}`)}
        onKeyDown={(event) => {
          const way = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 5, PageDown: -5 }[event.key];
          if (event.key === "Escape") cancelGesture();
          if (!way) return;
          event.preventDefault();
          edit([{ path: slide.path, value: nudge(value, way, range) }], slide.label, PRESSES);
        }} />
      {slide.grades.length > 0 && <datalist id={marks}>{slide.grades.map((g) => <option key={g} value={toSlider(g, range)} />)}</datalist>}
      <NumberField path={slide.path} label={slide.label} unit={slide.unit} hidden />
      <span class="unit">{slide.unit}</span>
      <span class="part-of">{line && <><svg class="bar" viewBox="0 0 100 10" preserveAspectRatio="none" aria-hidden="true"><rect y="1" width={100 * Math.min(1, line.variance_share)} height="8" /></svg>{percent(line.variance_share)}</>}</span>
      <span class="without">{line && mm(line.p95_without_mm)}</span>
      {slack && <span class="slack-of">{`slack ${slack}`}</span>}
    </div>
  );
}

// --- views and pivots ------------------------------------------------------------------------------------------------

export function Geometry() {
  const data = design.value, views: Json[] = Array.isArray(data?.views) ? data.views : [];
  const numbers = (part: Json, path: Path, skip: RegExp): { path: Path; label: string; unit: string }[] =>
    Object.entries(part ?? {}).flatMap(([name, value]) => {
      const unit = UNIT.exec(name)?.[1].replace("deg", "°") ?? "", label = name.replace(UNIT, "").replace(/_/g, " ");
      if (skip.test(name)) return [];
      if (typeof value === "number") return [{ path: [...path, name], label, unit }];
      if (Array.isArray(value) && value.length === 3 && value.every((v) => typeof v === "number")) {
        return value.map((_, k) => ({ path: [...path, name, k], label: `${label} ${"xyz"[k]}`, unit }));
      }
      return [];
    });
  const groups = [
    ...views.map((view, k) => ({ name: `View ${view?.name ?? k + 1}`, fields: numbers(view, ["views", k], /noise/) })),
    ...Object.entries(data?.interfaces ?? {}).map(([name, part]) => ({ name: name.replace(/_/g, " to "), fields: [...numbers(part, ["interfaces", name], /^$/), ...numbers((part as Json)?.bias, ["interfaces", name, "bias"], /^$/).map((f) => ({ ...f, label: `known bias ${f.label}` }))] })),
    ...(Array.isArray(data?.targets) ? data.targets.slice(0, 12).map((target: Json, k: number) => ({ name: `Target ${target?.name ?? k + 1}`, fields: numbers(target, ["targets", k], /^$/) })) : []),
    ...(Array.isArray(data?.requirements) ? data.requirements.map((r: Json, k: number) => ({ name: `Requirement ${r?.name ?? k + 1}`, fields: numbers(r, ["requirements", k], /^$/) })) : []),
  ];
  return (
    <div class="geometry">
      {groups.filter((g) => g.fields.length).map((group) => (
        <fieldset key={group.name}>
          <legend>{group.name}</legend>
          {group.fields.map((field: { path: Path; label: string; unit: string }) => <NumberField key={field.path.join("/")} {...field} what={`${group.name}: ${field.label}`} />)}
        </fieldset>
      ))}
    </div>
  );
}
