// How a design comes in and goes out: gallery, files, variants, the link, "copy as".

import { signal } from "@preact/signals";
import { useEffect, useState } from "preact/hooks";
import { answer, current, key, placeInWords, pointerOf, readRefusal, type Score, send, unreachable } from "../api";
import { canUndo, commit, design, differences, edit, type Json, keepVariant, linked, linkOf, LONGEST_LINK, open, parse, removeVariant, say, text, valueAt, variants } from "../state";
import { rounded } from "../geometry";
import { type Check, decisive } from "../verdicts";
import { mm, VERDICTS } from "../words";
import { ghost } from "./Pictures";
import { save } from "./Runs";

export const working = signal<string | null>(null); // what the page is busy with

const POINTS: Record<string, string> = { "mrk.json": "mrk.json", fcsv: "fcsv", csv: "csv", step: "step", stp: "step" }; // by ending
const LARGEST: Record<string, number> = { step: 32 }; // MB of a file, otherwise 1, as the command reads; the service may read less

/** Take a file: a design is opened; points, and the balls of a STEP file, become the design's fiducials. */
export async function takeFile(file: File): Promise<void> {
  const ending = Object.keys(POINTS).find((e) => file.name.toLowerCase().endsWith(`.${e}`)), kind = ending ? POINTS[ending] : "design", most = LARGEST[kind] ?? 1;
  if (file.size > 1e6 * most) return void say(`${file.name} has ${Math.round(file.size / 1e6)} MB; of this kind, files of at most ${most} MB are read`, true);
  if (ending) return takePoints(file, kind);
  const content = decode(await file.arrayBuffer());
  if (content === null) return void say(`${file.name} is not UTF-8 text: save it as UTF-8`, true);
  takeText(file.name, content, `Open ${file.name}`);
}

/** Text as the command reads it: UTF-8, or UTF-16 with its mark; null for anything else. */
function decode(content: ArrayBuffer): string | null {
  const [first, second] = new Uint8Array(content);
  const encoding = first === 0xff && second === 0xfe ? "utf-16le" : first === 0xfe && second === 0xff ? "utf-16be" : "utf-8";
  try {
    return new TextDecoder(encoding, { fatal: true }).decode(content);
  } catch {
    return null;
  }
}

/** Open a text that is a design; of any other, say what is wrong with it. */
export function takeText(name: string, content: string, what: string): void {
  const { errors, empty } = parse(content);
  if (errors.length) return void say(`${name} holds no design: ${errors[0].message}`, true);
  const same = content === text.value;
  open(content, what);
  const notes = empty.slice(0, 5).map(({ path }) => path.join(" › ")).join(", ");
  say(`${name} is ${same ? "what is open already" : "open"}.${canUndo.value && !same ? " Undo brings back what was here." : ""}${notes ? ` Fields without a value count as if they were not there: ${notes}.` : ""}`);
}

async function takePoints(file: File, format: string, more = ""): Promise<void> {
  const { name } = file;
  const started = !design.value;
  if (started && format !== "step") return void say(`${name} holds fiducials and no design: take one of the designs below or open one of yours, then drop ${name} on it.`, true);
  working.value = `${name} is being read`;
  const response = await send("POST", `/v1/conversions?from=${format}&to=${started ? "yaml" : "csv"}${more}`, file, { "Content-Type": "text/plain" }).catch(() => null).finally(() => (working.value = null));
  if (!response?.ok) {
    const problem = response ? await readRefusal(response) : unreachable(), [{ rule, detail }] = problem.errors;
    const called = detail.replaceAll(`content.${format}`, name), several = rule === "several-diameters" && !more;
    const diameter = several ? Number(window.prompt(`${called}. Which diameter have the fiducials, mm?`)?.replace(",", ".") ?? 0) : 0;
    if (diameter > 0) return takePoints(file, format, `&sphere_diameter_mm=${diameter}`);
    const cure = several ? "nothing was taken: open the file again and type one of these diameters" : problem.errors[0].hint;
    return void say(`${name}: ${[called, cure].filter(Boolean).join("; ")}`, true);
  }
  const made = await response.json(), own = new Map((design.value?.fiducials?.points ?? []).map((p: Json) => [p.label, p]));
  const points = made.fiducials.map((p: Json) => ({ ...(own.get(p.label) ?? {}), label: p.label, position_mm: rounded(p.position_mm, 4) }));
  const left = (made.bodies ?? []).filter((body: Json) => body.reason).map((body: Json) => `${body.path} was left: ${body.reason}`);
  const notes = [...made.notes, ...left].slice(0, 5).join("; ");
  if (started) open(made.content, `Open ${name}`);
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
    const response = await send("GET", `/v1/examples/${name}`, undefined, { Accept: "application/yaml" }).catch(() => null);
    if (!response) say(unreachable().title, true);
    else if (response.ok) {
      open(await response.text(), `Example ${name}`);
      requestAnimationFrame(() => document.getElementById("main")?.focus({ preventScroll: true })); // the card that was chosen is gone
    }
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
    linked.value = text.value;
    history.replaceState(null, "", link);
    await copy(link, "The link holds the whole design, and is copied.");
  };
  const address = `${location.origin}${location.pathname}`.replace(/\/$/, "");
  const forms: [string, () => string][] = [
    ["curl", () => `curl -s -H 'Content-Type: application/yaml' --data-binary @${fileName()}.yaml ${address}/v1/scores`],
    ["Python", () => `from tailstack import load_design, score\n\ndesign = load_design("${fileName()}.yaml")\nprint(score(design).targets[0].p95_mm)\n`],
    ["command", () => `tailstack score ${fileName()}.yaml`],
    ["CI gate", () => `# .github/workflows/tolerances.yml; COMMIT is that of your copy of tailstack\nname: tolerances\non: [pull_request]\npermissions: { contents: read }\njobs:\n  gate:\n    runs-on: ubuntu-24.04\n    timeout-minutes: 15\n    steps:\n      - uses: actions/checkout@11bd71901bbe5b1630ceea73d27597364c9af683 # v4.2.2\n      - uses: YOUR-ORGANISATION/tailstack@COMMIT\n        with: { designs: ${fileName()}.yaml, mode: auto }\n`],
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
  p95: number | null; // of the requirement that decides; without one, the largest P95
  status: string;
  decides?: Check;
}
const known = signal<Record<string, Numbers>>({}); // by text

const numbersOf = (score: Score): Numbers => {
  const decides = decisive(score.verdict.checks);
  return { p95: decides?.value_mm ?? Math.max(...score.targets.map((t) => t.p95_mm)), status: score.verdict.status, decides };
};

async function scoreOf(source: string): Promise<void> {
  const response = await send("POST", "/v1/scores", { design: parse(source).data }).catch(() => null);
  known.value = { ...known.value, [source]: response?.ok ? numbersOf(await response.json()) : { p95: null, status: "not-evaluated" } };
}

export function Variants() {
  const [compared, compare] = useState<string | null>(null);
  const now = answer.value, mine = now && current.value ? numbersOf(now.score) : null;
  for (const variant of variants.value) if (!(variant.text in known.value) && current.value) void once(variant.text); // not beside a score of the design
  const chosen = variants.value.find((v) => v.name === compared);
  return (
    <>
      <p><button type="button" onClick={() => { const name = keepVariant(); if (mine) known.value = { ...known.value, [text.value]: mine }; say(`Kept as variant ${name}.`); }}>Keep this design as a variant</button></p>
      {variants.value.length > 0 && (
        <div class="scroll" tabIndex={0} role="region" aria-label="Variants">
          <table>
            <caption>By estimate: the requirement that decides of each</caption>
            <thead><tr><th>Variant</th><th>Status</th><th class="number">Found, mm</th><th class="number">Limit, mm</th><th>What decides</th><th>Overlay</th><th>Differences</th><th>Take</th><th><span class="hidden">Remove</span></th></tr></thead>
            <tbody>
              <tr><th>now</th><Judged numbers={mine} /><td colSpan={4} /></tr>
              {variants.value.map((variant) => {
                const numbers = known.value[variant.text];
                return (
                  <tr key={variant.name}>
                    <th>{variant.name}</th><Judged numbers={numbers} />
                    <td><input type="checkbox" aria-label={`Draw ${variant.name} below`} checked={ghost.value === variant.name} onChange={(event) => (ghost.value = event.currentTarget.checked ? variant.name : null)} /></td>
                    <td><button type="button" class="small" aria-pressed={compared === variant.name} onClick={() => compare(compared === variant.name ? null : variant.name)}>compare</button></td>
                    <td><button type="button" class="small" onClick={() => commit(variant.text, `Variant ${variant.name}`)}>take</button></td>
                    <td><button type="button" class="small" aria-label={`Remove variant ${variant.name}`} onClick={() => removeVariant(variant.name)}>×</button></td>
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

function Judged({ numbers }: { numbers: Numbers | null | undefined }) {
  const decides = numbers?.decides;
  return (
    <>
      <td class={`status ${numbers?.status ?? ""}`}>{numbers ? VERDICTS[numbers.status] ?? numbers.status : ""}</td>
      <td class="number">{numbers ? mm(numbers.p95) : "…"}</td><td class="number">{mm(decides?.limit_mm)}</td>
      <td class="decides">{decides ? `${decides.requirement} at ${decides.target}: ${decides.headline}` : numbers ? "no requirement: the largest P95" : ""}</td>
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
