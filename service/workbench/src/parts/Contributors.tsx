// Who is to blame, and what is changed about it: one list of the contributors, each with its half-width to slide and to
// type, its share of the variance, what P95 would be without it, and how far it may be loosened.

import { effect, signal } from "@preact/signals";
import { useLayoutEffect, useRef } from "preact/hooks";
import type { components } from "../../../../openapi/typescript/tailstack";
import { gradesOf, type Line, placeOf } from "../advice";
import { answer, askWhenQuiet, budgetOf, current, late, openTables, readRefusal, type Refusal, refused, type Score, send, type TargetScore, targetNames, turnTable, unreachable } from "../api";
import { results, runs, start, unfinished } from "../jobs";
import { cancelGesture, comments, design, edit, finishGesture, gesture, type Json, opened, type Path, pointerOf, PRESSES, preview, valueAt } from "../state";
import type { HalfWidth } from "../sample";
import { before, decimals, decisive, estimated, type Joined, spread, standing } from "../readings";
import { brief, changed, mm, percent } from "../words";
import { NumberField, UNIT, unitOf } from "./Controls";
import { crossingOf, Curve, drawn } from "./Curve";
import { stepsOf } from "./grip";
import { Lock } from "./Limit";
import { Pin } from "./Pin";
import { Problems } from "./Problems";
import { Table, Term } from "./Words";

type Allowance = components["schemas"]["Allowance"];

const unfolded = signal<ReadonlyMap<string, boolean>>(new Map()); // families whose components were asked for, or sent away
const LARGE = 0.2; // share of a family whose components are shown before they are asked for, as those of the first are
const SLACK = "Slack to the limit", SHARES = "Shares at every target";

// --- half-widths that can be slid ------------------------------------------------------------------------------------

interface Slide extends HalfWidth {
  of: string; // the contributor
  what: string; // of it
}

/** Every half-width and standard deviation of the design, wherever it stands. */
export function slides(data: Json): Slide[] {
  const found: Slide[] = [];
  const visit = (part: Json, path: Path, words: string[]) => {
    if (part === null || typeof part !== "object") return;
    for (const [name, value] of Object.entries(part)) {
      const at = [...path, Array.isArray(part) ? Number(name) : name];
      if (typeof value === "number" && /^(half_width|std|fiducial_noise|target_noise)/.test(name) && UNIT.test(name)) {
        const what = /noise/.test(name) ? [name.replace(/_px$/, "").replace(/_/g, " ")] : [];
        found.push({ path: at, ...named([...words, ...what]), unit: unitOf([name]).replace("rel", "(1)").replace(/^k$/, "K") });
      } else if (name === "half_widths_px" && Array.isArray(value)) {
        value.forEach((_, degree) => found.push({ path: [...at, degree], ...named([...words, `field of degree ${degree}`]), unit: "px" }));
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

const named = (words: string[]) => ({ label: words.join(", "), of: words[0], what: words[words.length - 1] });

type Range = [number, number];
/** Of the slider, in the field's unit; what is typed may be beyond. */
const rangeOf = (unit: string): Range => unit === "(1)" ? [1e-5, 0.1] : [1e-3, 10];
const toSlider = (value: number, [low, high]: Range) => Math.round(1000 * (Math.log(Math.max(value, low) / low) / Math.log(high / low)));
const fromSlider = (at: number, [low, high]: Range) => Number((low * (high / low) ** (at / 1000)).toPrecision(2));

/** So many steps in the second digit from a value, tenths of them in the third. */
function nudge(value: number, steps: number, [low, high]: Range): number {
  const step = 10 ** (Math.floor(Math.log10(Math.max(value, low))) - 1);
  return Math.min(Math.max(high, value), Math.max(low, Number((value + steps * step).toPrecision(Math.abs(steps) < 1 ? 3 : 2))));
}

// --- contributors ------------------------------------------------------------------------------------------------------

/** A line of the budget, a half-width of the design, or both. */
interface Row {
  name: string;
  line?: Line;
  slide?: Slide;
}
interface Family extends Row {
  key: string;
  parts: Row[];
}

const lineKey = ({ name, component, law }: Line) => `${name} ${law === "known" ? "known" : component}`;

/** The source of errors to which a half-width belongs, as the budget calls it. */
function sourceOf(data: Json, path: Path): string {
  const [first, second, third] = path;
  if (first === "views") return `${String(third).replace(UNIT, "")}:${valueAt(data, [first, second])?.name}`;
  if (first === "interfaces" || second === "hand_eye") return String(second);
  return first === "fiducials" ? "fiducial_manufacturing" : String(first);
}

/** Contributors to one target of a scored design, each with its components, and every half-width of the present design at
 * the one that it is of. */
function familiesOf(data: Json, scored: Json, target: TargetScore | undefined): Family[] {
  const free = new Map(slides(data).map((slide) => [slide.path.join("/"), slide])), found = new Map<string, Family>();
  const familyOf = (key: string, name: string): Family => found.get(key) ?? found.set(key, { key, name, parts: [] }).get(key)!;
  for (const line of target?.contributors ?? []) {
    const place = placeOf(scored, line)?.join("/") ?? "", slide = free.get(place), known = line.law === "known";
    free.delete(place);
    const family = familyOf(known ? lineKey(line) : line.name, line.label || line.name); // what is known stands alone
    if (line.component === "all" || known) Object.assign(family, { line, slide });
    else family.parts.push({ name: line.component, line, slide });
  }
  for (const slide of free.values()) familyOf(sourceOf(data, slide.path), slide.of).parts.push({ name: slide.what, slide });
  return [...found.values()].map((family) => (family.line || family.parts.length > 1 ? family : { ...family, ...family.parts[0], name: family.name, parts: [] }));
}

const shareOf = ({ line, parts }: Family) => line?.variance_share ?? parts.reduce((sum, part) => sum + (part.line?.variance_share ?? 0), 0);

/** The order of the list: by share, as it was when the design was opened or when it was asked for; what is changed stays
 * where it is. */
const order = signal<ReadonlyMap<string, number>>(new Map());
const sort = () => (order.value = new Map((answer.peek()?.score.targets ?? []).flatMap((target) => target.contributors.map((line) => [JSON.stringify([target.name, lineKey(line)]), line.variance_share] as const))));
let sorted = -1; // which design that was opened
effect(() => {
  if (!answer.value || sorted === opened.value) return;
  sorted = opened.value;
  sort();
});

/** What a report says of this very design: how far each half-width is from where the limit is reached. */
function allowancesOf(score: Score): Allowance[] | null {
  const own = (record: { allowances?: Allowance[]; score?: Score }) => record.allowances && record.score?.provenance.design_sha256 === score.provenance.design_sha256;
  return Object.values(results.value).find(own)?.allowances ?? null;
}

/** Of which requirement at this target the slack is, and what else fails. */
function slackWords(allowances: Allowance[], target: string, score: Score): string {
  const requirement = allowances.find((a) => a.target === target && a.requirement !== null)?.requirement, worst = decisive(score.verdict.checks);
  if (!requirement) return `No slack at ${target}: ${allowances.some((a) => a.target === target) ? "no requirement names it" : "it is found for the targets with the largest P95, and for the one that decides"}.`;
  const words = `Slack: how far a half-width by itself may change until the estimate of ${requirement} at ${target}, which decides there, is at its limit, and what it then is.`;
  return worst && worst.status !== "pass" && worst.target !== target ? `${words} The design is judged by ${worst.requirement} at ${worst.target}: see the slack there.` : words;
}

/** How far a half-width may go by itself, with three digits that are within it; or why there is no such number. */
interface Slack {
  words: string;
  value: number | null;
}
function slackOf(allowance: Allowance | undefined): Slack | null {
  if (!allowance || allowance.half_width === 0) return null;
  if (allowance.at_limit === null) return { words: allowance.status, value: null };
  const worth = 10 ** (Math.floor(Math.log10(allowance.at_limit)) - 2), value = allowance.at_limit > 0 ? Number((Math.floor(allowance.at_limit / worth) * worth).toPrecision(3)) : null;
  return { words: `${brief(allowance.half_width)} → at most ${brief(value)} ${unit(allowance.unit)}`, value };
}

export function Contributors() {
  const score = answer.value?.score, data = design.value;
  const ranked = [...(score?.targets ?? [])].sort((a, b) => b.p95_mm - a.p95_mm), judged = score && decisive(score.verdict.checks)?.target;
  const target = ranked.find((t) => t.name === budgetOf.value) ?? ranked.find((t) => t.name === judged) ?? ranked[0];
  const limited = (score?.measures ?? []).filter(({ shares }) => shares.length), allowances = score ? allowancesOf(score) : null, seeking = runs.value.find((run) => run.title === SLACK && unfinished(run));
  const rank = (row: Row): number => (row.line && order.value.get(JSON.stringify([target?.name, lineKey(row.line)]))) ?? -1;
  const rankOf = (family: Family) => (family.line ? rank(family) : family.parts.reduce((sum, part) => sum + Math.max(0, rank(part)), 0));
  const families = familiesOf(data, answer.value?.design, target).map((family) => ({ ...family, parts: family.parts.sort((a, b) => rank(b) - rank(a)) })).sort((a, b) => rankOf(b) - rankOf(a));
  const first = families.filter(({ line }) => line).sort((a, b) => shareOf(b) - shareOf(a))[0];
  const turned = families.some((family, k) => k > 0 && shareOf(family) > shareOf(families[k - 1]) + 1e-9);
  const slack = ({ line }: Row) => (line ? slackOf(allowances?.find((each) => each.target === target.name && each.contributor === line.name && each.component === line.component)) : null);
  return (
    <div class={late.value || refused.value || !standing.value.holds ? "budget outdated" : "budget"} data-kind="estimate">
      {!standing.value.holds && standing.value.words && <p class="note">{standing.value.words}</p>}
      <p class="controls">
        {targetNames.value.length > 1 && (
          <label>Target{" "}
            <select value={target.name} onChange={(event) => { budgetOf.value = event.currentTarget.value; sort(); }}>
              {targetNames.value.map((name) => <option key={name}>{name}</option>)}
            </select>
          </label>
        )}
        {!allowances && score && score.verdict.checks.length > 0 && (
          <button type="button" disabled={!current.value || runs.value.some(unfinished)} onClick={() => start(SLACK, "/v1/reports", { parts: ["score"] })}>How far may each be loosened?</button>
        )}
        {score && <button type="button" aria-pressed={drawn.value} title="what is limited over each half-width by itself, and where it meets the limit" onClick={() => (drawn.value = !drawn.value)}>Curves</button>}
        {turned && <button type="button" class="small" onClick={sort}>Sort by share again</button>}
        {seeking && <span class="note" role="status">{`being computed: ${percent(seeking.fraction, 0)} `}<progress aria-label={SLACK} max={1} value={seeking.fraction} /></span>}
      </p>
      {first && target && <p class="blame steady">{`${blame(target, first)}${levels(families)}${toBlame(estimated.value?.joined)}`}</p>}
      {allowances && <p class="note">{slackWords(allowances, target.name, score!)}</p>}
      <div class="scroll" tabIndex={0} role="region" aria-label="Table of the budget">
        <table>
          <thead>
            <tr><th><Term word="contributor">Contributor</Term></th><th><Term word="half-width">Half-width</Term>{allowances ? " and slack" : ""}</th><th class="number"><Term word="share">Share</Term>; ▲▼ mm</th><th class="number"><Term word="P95">P95</Term> without, mm</th></tr>
          </thead>
          {families.map((family, k) => {
            const pinned = comments.value.some(({ contributor, component }) => component !== undefined && family.parts.some(({ line }) => line?.name === contributor));
            const open = unfolded.value.get(family.key) ?? (k === 0 || pinned || allowances !== null || !family.line || rankOf(family) >= LARGE);
            return (
              <tbody key={family.key}>
                <Entry row={family} parts={family.parts} target={target} share={family.line || family.parts.some(({ line }) => line) ? shareOf(family) : undefined} slack={slack(family)}
                  fold={family.parts.length ? { open, turn: () => (unfolded.value = new Map([...unfolded.value, [family.key, !open]])) } : undefined} />
                {open && family.parts.map((part) => <Entry key={part.slide?.path.join("/") ?? part.name} row={part} target={target} share={part.line?.variance_share} slack={slack(part)} below />)}
              </tbody>
            );
          })}
        </table>
      </div>
      {target && (targetNames.value.length > 1 || limited.length > 0) && <Matrix targets={ranked.slice(0, 8)} of={ranked.length} measures={limited} lines={target.contributors} />}
      {target && <Figures />}
    </div>
  );
}

/** What is most of the error, by estimate: a known bias first, which no tolerance cures. */
function blame(target: TargetScore, { name, line, ...first }: Family): string {
  const bias = Math.hypot(...target.bias_mm), share = percent(shareOf({ name, line, ...first })), d = decimals.value;
  if (bias > spread(target, 1)) return `At ${target.name}, a known bias of ${mm(bias, d)} mm is most of the error, whose P95 is estimated at ${mm(target.p95_mm, d)} mm: correct for it first. Of what varies, ${name} has most, ${share} of the variance.`;
  return `At ${target.name}, ${name} has most of the variance, ${share}; without it P95 would be ${mm(line!.p95_without_mm, d)} mm instead of ${mm(target.p95_mm, d)}, by estimate.`;
}

/** What has most of the measure that decides, where that is none of a target alone. */
function toBlame(joined?: Joined): string {
  const first = [...(joined?.shares ?? [])].sort((a, b) => b.variance_share - a.variance_share)[0];
  return first ? ` Of what decides, ${joined!.words}, ${first.label} has most, ${percent(first.variance_share)}.` : "";
}

/** How much of the variance is drawn anew how often. */
function levels(families: Family[]): string {
  const shares = new Map<string, number>();
  for (const family of families) {
    const level = (family.line ?? family.parts[0]?.line)?.drawn;
    if (level) shares.set(level, (shares.get(level) ?? 0) + shareOf(family));
  }
  return shares.size > 1 ? ` Drawn ${[...shares].sort((a, b) => b[1] - a[1]).map(([level, share]) => `per ${level}: ${percent(share)}`).join(", ")}.` : "";
}

interface Of {
  row: Row;
  parts?: Row[]; // of a family, which all are drawn as often
  target?: TargetScore;
  share?: number;
  slack: Slack | null;
  fold?: { open: boolean; turn(): void };
  below?: boolean;
}
function Entry({ row: { name, line, slide }, parts, target, share, slack, fold, below = false }: Of) {
  const old = target && before.value.estimate?.record.targets.find((each) => each.name === target.name), was = line && old?.contributors.find((each) => each.name === line.name && each.component === line.component);
  const d = decimals.value + 1, by = target && old && was && share !== undefined ? Number((spread(target, share) - spread(old, was.variance_share)).toFixed(d)) : 0; // mm: a share also grows where others fall
  const level = (line ?? parts?.[0]?.line)?.drawn;
  const stated = slide ? <Slider slide={slide} stop={slack?.value ?? null} /> : line?.half_width != null && `${brief(line.half_width)} ${unit(line.unit)}`;
  return (
    <tr class={`${below ? "below" : ""}${slide ? " slide" : ""}`}>
      <th scope="row" colSpan={fold && !stated ? 2 : 1}>{fold ? <button type="button" class="fold" aria-expanded={fold.open} onClick={fold.turn}>{name}</button> : name}{line && <Pin contributor={line.name} component={line.component === "all" ? undefined : line.component} />}{level && !below && <span class="drawn" title="how often it takes a new value">{` per ${level}`}</span>}</th>
      {!(fold && !stated) && <td>{stated}{slack && <span class="slack">{slack.words}{slide && slack.value !== null && slack.value !== valueAt(design.value, slide.path) && <>{" "}<button type="button" class="small" onClick={() => edit([{ path: slide.path, value: slack.value }], `${slide.label} to its limit`)}>take it</button></>}</span>}</td>}
      <td class="number share">
        {share !== undefined && <><svg class="bar" viewBox="0 0 100 10" preserveAspectRatio="none" aria-hidden="true"><rect width={100 * Math.min(1, share)} height="10" /></svg>{percent(share)}</>}
        {by !== 0 && <span class="delta" title="mm, by estimate: how much more or less error it makes by itself (root mean square)">{` ${changed(by, d)}`}</span>}
      </td>
      <td class="number">{line && mm(line.p95_without_mm, decimals.value)}</td>
    </tr>
  );
}

function Slider({ slide, stop }: { slide: Slide; stop: number | null }) {
  const data = design.value, value = valueAt(data, slide.path) as number, range = rangeOf(slide.unit), pointer = pointerOf(slide.path), met = crossingOf(pointer), grades = [...gradesOf(data, slide.path), ...[stop, met].filter((each) => each !== null)];
  const marks = `grades ${slide.path.join(" ")}`.replace(/\W+/g, "-");
  const slideTo = (at: number, width: number) => {
    const near = grades.find((grade) => Math.abs(toSlider(grade, range) - at) < Math.max(12, 2000 / width)); // two pixels
    preview([{ path: slide.path, value: near ?? fromSlider(at, range) }]);
  };
  return (
    <span class="half">
      <span class="track">
      <input type="range" min={0} max={1000} step={1} value={toSlider(value, range)} list={grades.length ? marks : undefined}
        aria-label={`${slide.label}: half-width`} aria-valuetext={`${brief(value)} ${slide.unit}`}
        onInput={(event) => slideTo(event.currentTarget.valueAsNumber, event.currentTarget.clientWidth)} onChange={() => finishGesture(`${slide.label}`)}
        onKeyDown={(event) => {
          const way = stepsOf(event, 5);
          if (event.key === "Escape") cancelGesture();
          if (!way) return;
          event.preventDefault();
          edit([{ path: slide.path, value: nudge(value, way, range) }], slide.label, PRESSES);
        }} />
      <Curve slide={slide} range={range} place={(value) => toSlider(value, range) / 1000} />
      </span>
      {grades.length > 0 && <datalist id={marks}>{grades.map((g) => <option key={g} value={toSlider(g, range)} />)}</datalist>}
      <NumberField path={slide.path} label={slide.label} unit={slide.unit} hidden />
      <span class="unit">{slide.unit}</span>
      <Lock path={slide.path} label={slide.label} />
    </span>
  );
}

/** Every target at once, and every measure that is limited. */
function Matrix({ targets, of, measures, lines }: { targets: TargetScore[]; of: number; measures: readonly Joined[]; lines: readonly Line[] }) {
  return (
    <details open={openTables.value.has(SHARES)} onToggle={(event) => turnTable(SHARES, event.currentTarget.open)}>
      <summary>{`Shares at every target${measures.length ? " and of every measure" : ""}`}</summary>
      {openTables.value.has(SHARES) && <Table name="Contributors by target" caption={<><Term word="budget">Budget</Term>{`${of > targets.length ? `: the ${targets.length} of ${of} targets with the largest P95` : ""}`}</>} head={<><th>Contributor</th>{targets.map((t) => <th class="number" key={t.name}>{t.name}</th>)}{measures.map(({ words, site }) => <th class="number" key={words + site}>{`${words}, ${site}`}</th>)}</>}>
        {lines.map((c, k) => (
          <tr key={lineKey(c)} class={c.component === "all" ? "" : "below"}>
            <th scope="row">{c.component === "all" ? c.label || c.name : `${c.label || c.name} ${c.component}`}</th>
            {targets.map((t) => <td class="number" key={t.name}>{percent(t.contributors[k]?.variance_share ?? 0)}</td>)}
            {measures.map(({ words, site, shares }) => <td class="number" key={words + site}>{c.component === "all" && c.law !== "known" ? percent(shares.find(({ name }) => name === c.name)?.variance_share ?? 0) : ""}</td>)}
          </tr>
        ))}
      </Table>}
    </details>
  );
}

// --- every figure: the tables of the report --------------------------------------------------------------------------

const unfoldedFigures = signal(false);
const figures = signal<{ design: Json; tables: Node[]; problem: Refusal | null } | null>(null);

/** The tables of the budget as the service writes them in a report. */
effect(() => {
  const sent = design.value;
  if (!unfoldedFigures.value || !current.value || gesture.value.length || figures.value?.design === sent) return;
  return askWhenQuiet(0, async (left) => {
    const response = await send("POST", "/v1/scores", { design: sent }, { Accept: "text/html" }, left).catch(() => null);
    if (left.aborted) return;
    const problem = response?.ok ? null : response ? await readRefusal(response) : unreachable();
    const page = new DOMParser().parseFromString(problem ? "" : (await response!.text()).replace(/<style>.*?<\/style>/s, ""), "text/html");
    const section = [...page.querySelectorAll("section")].find((part) => part.querySelector("h2")?.textContent?.endsWith(" Budget"));
    figures.value = { design: sent, tables: [...(section?.querySelectorAll(".scroll:has(table)") ?? [])], problem };
  });
});

function Figures() {
  const box = useRef<HTMLDivElement>(null), held = figures.value, other = held && held.design !== design.value;
  useLayoutEffect(() => box.current?.replaceChildren(...(held?.tables ?? []).map((table) => document.importNode(table, true))), [held]);
  const turn = (open: boolean) => {
    if (open && figures.value?.problem) figures.value = null; // it is asked for once more
    unfoldedFigures.value = open;
  };
  return (
    <details open={unfoldedFigures.value} onToggle={(event) => turn(event.currentTarget.open)}>
      <summary>Every figure of the budget, as the report has it</summary>
      {unfoldedFigures.value && !held && <p class="note" role="status">being written …</p>}
      {held?.problem && <Problems problem={held.problem} />}
      <div ref={box} class={other ? "figures outdated" : "figures"} />
    </details>
  );
}

const unit = (name: string) => name.replace("deg", "°");
