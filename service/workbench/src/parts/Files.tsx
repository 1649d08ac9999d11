// How a design comes in and goes out: gallery, files, variants, the link, "copy as".

import { signal } from "@preact/signals";
import { useEffect, useState } from "preact/hooks";
import { answer, current, key, placeInWords, pointerOf, readRefusal, send, unreachable } from "../api";
import { canUndo, commit, design, differences, edit, type Json, keepVariant, linkOf, LONGEST_LINK, open, parse, setVariants, text, valueAt, variants, writeYaml } from "../state";
import { rounded } from "../geometry";
import { mm, VERDICTS } from "../words";
import { ghost } from "./Pictures";
import { save } from "./Runs";

export const message = signal<{ words: string; bad: boolean } | null>(null);
export const say = (words: string, bad = false) => (message.value = { words, bad });

const POINTS: Record<string, string> = { "mrk.json": "mrk.json", fcsv: "fcsv", csv: "csv", step: "step", stp: "step" }; // by ending
const LARGEST: Record<string, number> = { step: 32 }; // MB of a file that is read at all, otherwise 4; the service has its own limits

/** Take a file: a design is opened; points, and the balls of a STEP file, become the design's fiducials. */
export async function takeFile(file: File): Promise<void> {
  const ending = Object.keys(POINTS).find((e) => file.name.toLowerCase().endsWith(`.${e}`)), kind = ending ? POINTS[ending] : "design", most = LARGEST[kind] ?? 4;
  if (file.size > 1e6 * most) return void say(`${file.name} has ${Math.round(file.size / 1e6)} MB; of this kind, files of at most ${most} MB are read`, true);
  const content = await file.text();
  if (ending) return takePoints(file.name, kind, content);
  const { data, errors } = parse(content);
  if (errors.length) return void say(`${file.name} is neither YAML nor JSON: ${errors[0].message}`, true);
  if (data === null || typeof data !== "object" || Array.isArray(data)) return void say(`${file.name} holds no design: a design is a mapping with views, fiducials, targets`, true);
  open(content, `Open ${file.name}`);
  say(`${file.name} is open. Undo brings back what was here.`);
}

async function takePoints(name: string, format: string, content: string, more = ""): Promise<void> {
  if (!design.value && format !== "step") return void say("Open a design first; then drop the fiducials on it.", true);
  const response = await send("POST", `/v1/conversions?from=${format}&to=yaml${more}`, content, { "Content-Type": "text/plain" }).catch(() => null);
  if (!response?.ok) {
    const problem = response ? await readRefusal(response) : unreachable(), [{ rule, detail }] = problem.errors;
    const diameter = rule === "several-diameters" && !more ? Number(window.prompt(`${detail}. Which diameter have the fiducials, mm?`)?.replace(",", ".") ?? 0) : 0;
    if (diameter > 0) return takePoints(name, format, content, `&sphere_diameter_mm=${diameter}`);
    return void say(`${name}: ${[problem.errors[0].detail, problem.errors[0].hint].filter(Boolean).join("; ")}`, true);
  }
  const made = await response.json(), own = new Map((design.value?.fiducials?.points ?? []).map((p: Json) => [p.label, p]));
  const points = made.fiducials.map((p: Json) => ({ ...(own.get(p.label) ?? {}), label: p.label, position_mm: rounded(p.position_mm, 4) }));
  const notes = [...made.notes, ...(made.bodies ?? []).filter((body: Json) => body.reason).map((body: Json) => `${body.path} was left: ${body.reason}`)].slice(0, 5).join("; ");
  if (!design.value) open(made.content, `Open ${name}`);
  else {
    const kept = Object.fromEntries(Object.entries(design.value.fiducials ?? {}).filter(([field]) => !["points", "file", "region", "frame"].includes(field)));
    edit([{ path: ["fiducials"], value: { points, ...kept } }], `Fiducials of ${name}`);
  }
  say(`${points.length} fiducials of ${name} are in the design.${canUndo.value ? " Undo brings back those before." : ""}${notes ? ` ${notes}` : ""}`);
}

// --- the gallery ---------------------------------------------------------------------------------------------------------

interface Example {
  name: string;
  title: string;
  description: string;
}
const gallery = signal<Example[] | null>(null);

export function Gallery() {
  useEffect(() => {
    if (!gallery.value) void send("GET", "/v1/examples").then(async (r) => r.ok && (gallery.value = (await r.json()).examples)).catch(() => null);
  }, [key.value]);
  const take = async (name: string) => {
    const response = await send("GET", `/v1/examples/${name}`).catch(() => null);
    if (!response) say(unreachable().title, true);
    else if (response.ok) open(writeYaml(await response.json()), `Example ${name}`);
  };
  return (
    <ul class="gallery">
      {(gallery.value ?? []).map((example) => (
        <li key={example.name}><button type="button" onClick={() => take(example.name)}><strong>{example.title}</strong><span>{example.description}</span></button></li>
      ))}
    </ul>
  );
}

export function OpenFile({ words }: { words: string }) {
  return (
    <label class="button">
      {words}
      <input type="file" class="hidden" accept=".yaml,.yml,.json,.csv,.fcsv,.step,.stp" onChange={(event) => {
        const file = event.currentTarget.files?.[0];
        event.currentTarget.value = "";
        if (file) void takeFile(file);
      }} />
    </label>
  );
}

// --- out ------------------------------------------------------------------------------------------------------------------

const fileName = () => `${String(design.value?.name ?? "design").toLowerCase().replace(/[^a-z0-9]+/g, "-").replace(/^-|-$/g, "").slice(0, 60) || "design"}`;

export function TakeAway() {
  const copyLink = async () => {
    const link = await linkOf(text.value);
    if (link.length > LONGEST_LINK) {
      save(new Blob([text.value], { type: "application/yaml" }), `${fileName()}.yaml`);
      say(`The design is too large for a link (${link.length} characters; ${LONGEST_LINK} survive mail and chats): it was saved as a file, send that.`);
      return;
    }
    history.replaceState(null, "", link);
    await copy(link, "The link holds the whole design, and is copied.");
  };
  const address = `${location.origin}${location.pathname}`.replace(/\/$/, "");
  const forms: [string, () => string][] = [
    ["curl", () => `curl -s -H 'Content-Type: application/yaml' --data-binary @${fileName()}.yaml ${address}/v1/scores`],
    ["Python", () => `from tailstack import load_design, score\n\ndesign = load_design("${fileName()}.yaml")\nprint(score(design).targets[0].p95_mm)\n`],
    ["command", () => `tailstack score ${fileName()}.yaml`],
    ["CI gate", () => `# .github/workflows/tolerances.yml\nname: tolerances\non: [push]\njobs:\n  gate:\n    runs-on: ubuntu-latest\n    steps:\n      - uses: actions/checkout@v4\n      - run: pip install tailstack\n      - run: tailstack gate ${fileName()}.yaml --mode auto\n`],
  ];
  return (
    <div class="controls" role="group" aria-label="Take away">
      <button type="button" onClick={() => save(new Blob([text.value], { type: "application/yaml" }), `${fileName()}.yaml`)}>Save YAML</button>
      <button type="button" onClick={() => save(new Blob([JSON.stringify(design.value, null, 2)], { type: "application/json" }), `${fileName()}.json`)}>Save JSON</button>
      <button type="button" onClick={copyLink}>Link to this design</button>
      {forms.map(([name, make]) => <button type="button" key={name} onClick={() => copy(make(), `Copied as ${name}.`)}>{`Copy as ${name}`}</button>)}
    </div>
  );
}

async function copy(content: string, words: string): Promise<void> {
  try {
    await navigator.clipboard.writeText(content);
    say(words);
  } catch {
    say(`${words.replace(/ (and is copied|is copied)\.?|Copied/, "")} The browser does not let the page copy; here it is: ${content}`);
  }
}

// --- variants ---------------------------------------------------------------------------------------------------------------

interface Numbers {
  p95: number | null;
  status: string;
}
const known = signal<Record<string, Numbers>>({}); // by text

async function scoreOf(source: string): Promise<void> {
  const response = await send("POST", "/v1/scores", { design: parse(source).data }).catch(() => null);
  const score = response?.ok ? await response.json() : null;
  const check = score?.verdict.checks[0];
  known.value = { ...known.value, [source]: { p95: check?.value_mm ?? score?.targets[0].p95_mm ?? null, status: score?.verdict.status ?? "not-evaluated" } };
}

export function Variants() {
  const [compared, compare] = useState<string | null>(null);
  const now = answer.value, mine = now && current.value ? { p95: now.score.verdict.checks[0]?.value_mm ?? now.score.targets[0].p95_mm, status: now.score.verdict.status } : null;
  for (const variant of variants.value) if (!(variant.text in known.value) && current.value) void once(variant.text); // not beside a score of the design
  const chosen = variants.value.find((v) => v.name === compared);
  return (
    <>
      <p><button type="button" onClick={() => { const name = keepVariant(); if (mine) known.value = { ...known.value, [text.value]: mine }; say(`Kept as variant ${name}.`); }}>Keep this design as a variant</button></p>
      {variants.value.length > 0 && (
        <div class="scroll" tabIndex={0} role="region" aria-label="Variants">
          <table>
            <thead><tr><th>Variant</th><th class="number">Judged value, mm</th><th>Status</th><th>Overlay</th><th>Differences</th><th>Take</th><th><span class="hidden">Remove</span></th></tr></thead>
            <tbody>
              <tr><th>now</th><td class="number">{mm(mine?.p95)}</td><td>{mine ? VERDICTS[mine.status] ?? mine.status : "…"}</td><td colSpan={4} /></tr>
              {variants.value.map((variant) => {
                const numbers = known.value[variant.text];
                return (
                  <tr key={variant.name}>
                    <th>{variant.name}</th><td class="number">{numbers ? mm(numbers.p95) : "…"}</td><td>{numbers ? VERDICTS[numbers.status] ?? numbers.status : ""}</td>
                    <td><input type="checkbox" aria-label={`Draw ${variant.name} below`} checked={ghost.value === variant.name} onChange={(event) => (ghost.value = event.currentTarget.checked ? variant.name : null)} /></td>
                    <td><button type="button" class="small" aria-pressed={compared === variant.name} onClick={() => compare(compared === variant.name ? null : variant.name)}>compare</button></td>
                    <td><button type="button" class="small" onClick={() => commit(variant.text, `Variant ${variant.name}`)}>take</button></td>
                    <td><button type="button" class="small" aria-label={`Remove variant ${variant.name}`} onClick={() => setVariants(variants.value.filter((v) => v !== variant))}>×</button></td>
                  </tr>
                );
              })}
            </tbody>
          </table>
        </div>
      )}
      {chosen && <Differences name={chosen.name} before={parse(chosen.text).data} />}
    </>
  );
}

const asked = new Set<string>();
async function once(source: string): Promise<void> {
  if (asked.has(source)) return;
  asked.add(source);
  await scoreOf(source);
}

function Differences({ name, before }: { name: string; before: Json }) {
  const rows = differences(before, design.value);
  if (!rows.length) return <p>{`The design is variant ${name}.`}</p>;
  const brief = (value: Json) => (value === undefined ? "–" : JSON.stringify(value).slice(0, 60));
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label={`Differences from variant ${name}`}>
      <table>
        <thead><tr><th>Field</th><th class="number">{name}</th><th class="number">now</th></tr></thead>
        <tbody>{rows.slice(0, 100).map((row) => <tr key={pointerOf(row.path)}><th>{placeInWords(design.value, pointerOf(row.path))}</th><td class="number">{brief(valueAt(before, row.path))}</td><td class="number">{brief(row.value)}</td></tr>)}</tbody>
      </table>
    </div>
  );
}
