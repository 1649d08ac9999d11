// What is changed by typing: beads, angles and distances of the views, pivots, targets, limits.

import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";
import { adding, type Bead, beads, toggle } from "../beads";
import { design, edit, type Json, type Path, picked, pointed, selected, valueAt } from "../state";
import { readNumber, whyNoNumber } from "../words";
import { Pin } from "./Pin";

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
    if (!field.current) return; // it goes with the design that it is of, and loses the focus so
    const text = field.current.value, number = readNumber(text, unit);
    if (text.trim() === "") field.current.value = String(value ?? "");
    setWrong(text.trim() !== "" && number === null ? text : null);
    if (text.trim() === "" || number === null) return;
    if (number === value) field.current.value = String(value);
    else {
      field.current.defaultValue = text;
      edit([{ path, value: number }], what ?? `${label} ${number} ${unit}`.trim());
    }
  };
  return (
    <>
    <label class="field">
      <span class={hidden ? "hidden" : ""}>{`${label}${unit ? `, ${unit}` : ""}`}</span>
      <input ref={field} type="text" inputMode="decimal" data-pointer={path.join("/")} onBlur={take} aria-invalid={wrong !== null} onInput={() => setWrong(null)}
        onKeyDown={(event) => { if (event.key === "Enter") take(); else if (event.key === "Escape") { event.currentTarget.value = String(value ?? ""); event.currentTarget.blur(); } }} />
    </label>
    {wrong !== null && <span class="wrong" role="alert">{`${whyNoNumber(wrong, unit)}; the design has ${value}`}</span>}
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
              <tr key={bead.index} class={`${picked.value.includes(bead.label) ? "chosen" : ""}${bead.label === pointed.value ? " over" : ""}`} onClick={(event) => (event.shiftKey || adding.value ? toggle(bead.label) : (selected.value = bead.label))}
                onPointerEnter={() => (pointed.value = bead.label)} onPointerLeave={() => (pointed.value = null)} onFocusIn={() => (pointed.value = bead.label)} onFocusOut={() => (pointed.value = null)}>
                <th>{bead.label}<Pin bead={bead.label} /></th>
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

// --- views and pivots ------------------------------------------------------------------------------------------------

/** The unit at the end of a field's name. */
export const UNIT = /_(mm|deg|px|n|k|mm_per_n|rel)$/;
/** That of the value at a path, of a list's item too. */
export const unitOf = (path: Path): string => UNIT.exec(String(path.filter((part) => typeof part === "string").pop()))?.[1].replace("deg", "°") ?? "";

const MOST_TARGETS = 12; // that have fields here

export function Geometry() {
  const data = design.value, views: Json[] = Array.isArray(data?.views) ? data.views : [];
  const numbers = (part: Json, path: Path, skip: RegExp): { path: Path; label: string; unit: string }[] =>
    Object.entries(part ?? {}).flatMap(([name, value]) => {
      const unit = unitOf([name]), label = name.replace(UNIT, "").replace(/_/g, " ");
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
    ...(Array.isArray(data?.targets) ? data.targets.slice(0, MOST_TARGETS).map((target: Json, k: number) => ({ name: `Target ${target?.name ?? k + 1}`, fields: numbers(target, ["targets", k], /^$/) })) : []),
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
      {data?.targets?.length > MOST_TARGETS && <p class="note">{`The first ${MOST_TARGETS} of ${data.targets.length} targets; the others are under "All fields".`}</p>}
    </div>
  );
}
