// Every field of the design, from the JSON Schema: name, description, unit, bounds.

import { signal } from "@preact/signals";
import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";
import { key, reachable, refused, send } from "../api";
import { showValue, unitOf } from "./Controls";
import { design, type Edit, edit, type Json, type Path, pointerOf, valueAt } from "../state";
import { readNumber } from "../words";

export const schema = signal<Json>(null);

/** The schema is fetched for the parts that show it: the first score does not wait for it. */
export function useSchema(): void {
  useEffect(() => {
    if (!schema.value) void send("GET", "/v1/schemas/design").then(async (response) => response.ok && (schema.value = await response.json())).catch(() => null);
  }, [key.value, reachable.value]);
}

export function resolve(node: Json): Json {
  let at = node;
  while (at?.$ref) at = { ...at.$ref.split("/").slice(1).reduce((part: Json, name: string) => part[name], schema.value), ...without(at, "$ref") };
  return at?.allOf?.length === 1 ? { ...resolve(at.allOf[0]), ...without(at, "allOf") } : at;
}

const without = (object: Json, name: string) => Object.fromEntries(Object.entries(object).filter(([key]) => key !== name));

/** The alternative of a union that fits the value best; where alternatives only say which of its own fields are needed, the
 * node itself. */
export function choose(node: Json, value: Json): Json {
  const full = resolve(node), options: Json[] | undefined = (full.anyOf ?? full.oneOf)?.map(resolve);
  if (!options || full.properties) return full;
  const fits = options.map((option) => {
    if (value === undefined || value === null) return option.type === "null" ? 0 : 1;
    const kind = Array.isArray(value) ? "array" : typeof value === "object" ? "object" : typeof value === "boolean" ? "boolean" : typeof value;
    const kinds = option.type === "integer" ? ["number"] : [option.type ?? (option.properties ? "object" : option.enum || option.const ? typeof (option.const ?? option.enum[0]) : kind)];
    if (!kinds.includes(kind)) return 0;
    if (kind !== "object") return 2;
    const known = Object.keys(option.properties ?? {}), missing = (option.required ?? []).filter((name: string) => !(name in value)).length;
    return 3 + Object.keys(value).filter((name) => known.includes(name)).length - 2 * missing;
  });
  const best = options[fits.indexOf(Math.max(...fits))];
  return { ...best, description: full.description ?? best.description };
}

const bounds = (node: Json) => [
  node.minimum !== undefined && `at least ${node.minimum}`, node.exclusiveMinimum !== undefined && `above ${node.exclusiveMinimum}`,
  node.maximum !== undefined && `at most ${node.maximum}`, node.exclusiveMaximum !== undefined && `below ${node.exclusiveMaximum}`,
].filter(Boolean).join(", ");

export function Form() {
  useSchema();
  if (!schema.value) return <p class="note">The form needs the service's schema, which has not arrived.</p>;
  return <div class="form">{design.value && <Fields node={schema.value} path={[]} value={design.value} />}</div>;
}

function Fields({ node, path, value }: { node: Json; path: Path; value: Json }) {
  const properties: [string, Json][] = Object.entries(node.properties ?? {}).filter(([name]) => path.length || name !== "review"), required = new Set(node.required ?? []);
  const present = properties.filter(([name]) => value?.[name] !== undefined);
  const absent = properties.filter(([name]) => value?.[name] === undefined);
  const strange = Object.keys(value ?? {}).filter((name) => !node.properties?.[name]);
  return (
    <>
      {present.map(([name, part]) => <Field key={name} name={name} node={part} path={[...path, name]} value={value[name]} needed={required.has(name)} />)}
      {strange.map((name) => typeof node.additionalProperties === "object"
        ? <Field key={name} name={name} node={node.additionalProperties} path={[...path, name]} value={value[name]} needed={false} />
        : <p key={name} class="bad">{`${name}: there is no such field`} <Remove path={[...path, name]} /></p>)}
      {absent.length > 0 && <Add absent={absent} path={path} />}
    </>
  );
}

function Add({ absent, path }: { absent: [string, Json][]; path: Path }) {
  const place = path.length ? path.join(" › ") : "the design";
  return (
    <label class="add">
      <span class="hidden">{`Add a field to ${place}`}</span>
      <select value="" onChange={(event) => {
        const found = absent.find(([name]) => name === event.currentTarget.value);
        event.currentTarget.value = "";
        if (found) edit([{ path: [...path, found[0]], value: example(found[1]) }], `Add ${found[0]}`);
      }}>
        <option value="">{`Add to ${place} …`}</option>
        {absent.map(([name, node]) => <option key={name} value={name} title={resolve(node).description}>{name}</option>)}
      </select>
    </label>
  );
}

const Remove = ({ path }: { path: Path }) => (
  <button type="button" class="small" aria-label={`Remove ${path.join(" ")}`} title="Remove" onClick={() => edit([{ path, value: undefined }], `Remove ${path[path.length - 1]}`)}>×</button>
);

/** A value to begin with: the schema's default or example, else the smallest thing of its shape; a list of things begins
 * with one, for nobody adds it to leave it empty. */
export function example(node: Json, depth = 0): Json {
  const full = resolve(node);
  if (full.examples?.length && full.examples[0] !== null) return full.examples[0];
  if (full.default !== undefined && full.default !== null && !(Array.isArray(full.default) && !full.default.length)) return full.default;
  if (full.const !== undefined) return full.const;
  if (full.enum) return full.enum[0];
  const options: Json[] | undefined = (full.anyOf ?? full.oneOf)?.map(resolve), first = options?.find((o) => o.type !== "null");
  if (full.properties) { // with alternatives: what each of them asks for besides
    const required: string[] = [...(full.required ?? []), ...(first?.required ?? [])];
    return depth > 5 ? {} : Object.fromEntries(required.filter((name) => full.properties[name]).map((name) => [name, example(full.properties[name], depth + 1)]));
  }
  if (first) return example(first, depth);
  if (full.type === "object") return {};
  if (full.type === "array") {
    if (full.prefixItems) return full.prefixItems.map((item: Json) => example(item, depth + 1));
    return Array.from({ length: full.minItems ?? 1 }, () => example(full.items, depth + 1));
  }
  if (full.type === "boolean") return false;
  if (full.type === "string") return full.minLength ? "name" : "";
  return full.minimum ?? (full.exclusiveMinimum !== undefined ? full.exclusiveMinimum + 1 : 0);
}

/** One more of a list: like the last that is there, under a name of its own; the first as the schema has it. */
export function another(node: Json, list: Json[]): Json {
  const last = list[list.length - 1], made = last === undefined ? example(node) : structuredClone(last);
  const used = new Set(list.flatMap((each) => [each?.name, each?.label, each]));
  const fresh = (name: string) => {
    const [, stem, number] = /^(.*?)(\d*)$/s.exec(name)!;
    let k = Number(number || 1);
    while (used.has(`${stem}${k}`) || `${stem}${k}` === name) k += 1;
    return used.has(name) ? `${stem}${k}` : name;
  };
  if (typeof made === "string") return fresh(made);
  if (made !== null && typeof made === "object" && !Array.isArray(made)) for (const field of ["name", "label"]) if (typeof made[field] === "string") made[field] = fresh(made[field]);
  if (list.length && Array.isArray(made?.position_mm)) made.position_mm[0] += 10; // two at one place are refused
  return made;
}

/** Whether a list is one value, of as many numbers as it has: all others grow and shrink. */
const isVector = (node: Json, value: Json[]) => Boolean(node.prefixItems) || (node.maxItems !== undefined && node.maxItems === node.minItems) || (!node.items && value.every((v) => typeof v !== "object"));

function Field({ name, node, path, value, needed }: { name: string; node: Json; path: Path; value: Json; needed: boolean }) {
  const chosen = choose(node, value), pointer = pointerOf(path);
  const wrong = refused.value?.errors.filter((error) => error.pointer === pointer) ?? [];
  const title = typeof path[path.length - 1] === "number" ? value?.label ?? value?.name ?? `item ${name}` : name;
  if (value !== null && typeof value === "object" && !(Array.isArray(value) && isVector(chosen, value))) {
    return (
      <Group title={title} description={chosen.description} path={path} needed={needed} size={Array.isArray(value) ? `${value.length}` : ""}>
        {() => Array.isArray(value) ? <Items node={chosen} path={path} value={value} /> : <Fields node={chosen} path={path} value={value} />}
      </Group>
    );
  }
  return (
    <div class={wrong.length ? "formfield wrong" : "formfield"}>
      {Array.isArray(value) ? (
        <span class="values" role="group" aria-label={title}>
          <span class="name">{title}</span>
          {value.map((_, k) => <Leaf key={k} node={chosen.prefixItems?.[k] ?? chosen.items ?? {}} path={[...path, k]} label={`${title} ${k + 1}`} hidden />)}
        </span>
      ) : <Leaf node={chosen} path={path} label={title} />}
      {!needed && <Remove path={path} />}
      <span class="note">{[chosen.description, bounds(chosen)].filter(Boolean).join(" ")}</span>
      {wrong.map((error) => <span key={error.detail} class="bad">{`${error.detail} ${error.hint}`}</span>)}
    </div>
  );
}

function Group({ title, description, path, needed, size, children }: { title: string; description?: string; path: Path; needed: boolean; size: string; children: () => Json }) {
  const [open, setOpen] = useState(false);
  return (
    <details open={open} onToggle={(event) => setOpen(event.currentTarget.open)}>
      <summary>{title}{size && <span class="note">{` (${size})`}</span>}</summary>
      {!needed && <p class="note">Take this part out of the design <Remove path={path} /></p>}
      {description && <p class="note">{description}</p>}
      {open && children()}
    </details>
  );
}

function Items({ node, path, value }: { node: Json; path: Path; value: Json[] }) {
  return (
    <>
      {value.map((item, k) => <Field key={k} name={String(k + 1)} node={node.items ?? node.prefixItems?.[k] ?? {}} path={[...path, k]} value={item} needed={false} />)}
      {node.items && (node.maxItems === undefined || value.length < node.maxItems) && <button type="button" class="small" onClick={() => edit([{ path: [...path, value.length], value: another(node.items, value) }], `Add to ${path[path.length - 1]}`)}>{value.length ? "Add one more" : `Add the first of ${path[path.length - 1]}`}</button>}
    </>
  );
}

/** A limit in the unit of the measure that was chosen, in place of that in the unit of another. */
export function limitOf({ "x-limited-by": fields }: Json, path: Path, chosen: Json): Edit[] {
  const own = path.slice(0, -1), [from, to] = fields ? [fields[valueAt(design.value, path)], fields[chosen]] : [];
  return from === to ? [] : [{ path: [...own, from], value: undefined }, { path: [...own, to], value: 1 }];
}

/** One value in a field of its kind. */
export function Leaf({ node, path, label, hidden = false }: { node: Json; path: Path; label: string; hidden?: boolean }) {
  const value = valueAt(design.value, path), chosen = choose(node, value), field = useRef<HTMLInputElement>(null);
  const choices: Json[] | undefined = chosen.enum ?? (chosen.const !== undefined ? [chosen.const] : undefined);
  useLayoutEffect(() => showValue(field.current, value), [value]);
  const give = (next: Json) => next !== value && edit([{ path, value: next }, ...limitOf(chosen, path, next)], `${label}`);
  const name = <span class={hidden ? "hidden" : "name"}>{label}</span>;
  if (typeof value === "boolean") return <label>{name}<input type="checkbox" checked={value} onChange={(event) => give(event.currentTarget.checked)} /></label>;
  if (choices && choices.length > 1) {
    return (
      <label>{name}
        <select value={String(value)} onChange={(event) => give(choices.find((c) => String(c) === event.currentTarget.value))}>
          {choices.map((choice) => <option key={String(choice)}>{String(choice)}</option>)}
        </select>
      </label>
    );
  }
  const take = () => {
    if (!field.current) return; // it goes with the design that it is of, and loses the focus so
    const text = field.current.value, number = typeof value === "number" ? readNumber(text, unitOf(path)) : null;
    if (typeof value === "number" && (number === value || text.trim() === "")) return void (field.current.value = String(value));
    field.current.defaultValue = text;
    give(number ?? text);
  };
  return (
    <label>{name}
      <input ref={field} type="text" data-form={pointerOf(path)} onBlur={take} onKeyDown={(event) => { if (event.key === "Enter") take(); }} />
    </label>
  );
}
