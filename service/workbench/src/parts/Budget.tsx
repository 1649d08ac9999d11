// Which contributor is to blame: a matrix of contributors and targets, and a waterfall of one target's variance.

import { signal } from "@preact/signals";
import type { components } from "../../../../openapi/typescript/tailstack";
import { answer, current, late, refused, type Score, type TargetScore } from "../api";
import { results, runs, start, unfinished } from "../jobs";
import { before, decisive, shareKey } from "../verdicts";
import { Term } from "./Words";
import { brief, changed, mm, percent } from "../words";

type Allowance = components["schemas"]["Allowance"];

const shown = signal<string | null>(null); // target of the waterfall
const all = signal(false);
const SLACK = "Slack to the limit";

/** Contributors of a target, each with its components: the lines of "all" add up, their components are below them. */
function families(target: TargetScore): { whole: number; parts: number[] }[] {
  const found = new Map<string, { whole: number; parts: number[] }>();
  target.contributors.forEach((c, k) => {
    const key = c.law === "known" ? `${c.name} known` : c.name; // what is known stands alone
    const family = found.get(key) ?? { whole: -1, parts: [] };
    if (c.component === "all") family.whole = k;
    else family.parts.push(k);
    found.set(key, family);
  });
  const share = (k: number) => target.contributors[k].variance_share;
  const all = [...found.values()].flatMap((f) => (f.whole >= 0 ? [f] : f.parts.map((k) => ({ whole: k, parts: [] }))));
  for (const family of all) family.parts.sort((a, b) => share(b) - share(a));
  return all.sort((a, b) => share(b.whole) - share(a.whole));
}

/** What a report says of this very design: how far each half-width is from where the limit is reached. */
export function allowancesOf(score: Score): Allowance[] | null {
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

/** "+0.12 to 0.27 °", or why there is no such number. */
export function slackOf(allowance: Allowance | undefined): string {
  if (!allowance || allowance.half_width === 0) return "";
  if (allowance.slack === null || allowance.at_limit === null) return allowance.status;
  const sign = allowance.slack < 0 ? "" : "+";
  return `${sign}${brief(allowance.slack)} to ${brief(allowance.at_limit)} ${unit(allowance.unit)}`;
}

export function Budget() {
  const score = answer.value?.score;
  if (!score) return null;
  const ranked = [...score.targets].sort((a, b) => b.p95_mm - a.p95_mm);
  const judged = decisive(score.verdict.checks)?.target;
  const target = ranked.find((t) => t.name === shown.value) ?? ranked.find((t) => t.name === judged) ?? ranked[0];
  const rows = families(target), columns = ranked.slice(0, 8), first = rows[0] && target.contributors[rows[0].whole];
  const allowances = allowancesOf(score), open = all.value || allowances !== null;
  const seeking = runs.value.find((run) => run.title === SLACK && unfinished(run));
  let reached = 0;
  return (
    <div class={late.value || refused.value ? "budget old" : "budget"}>
      {first && (
        <p>{`At ${target.name}, ${first.label || first.name} has most of the variance, ${percent(first.variance_share)}; without it P95 would be ${mm(first.p95_without_mm)} mm instead of ${mm(target.p95_mm)}.`}</p>
      )}
      <p class="controls">
        {score.targets.length > 1 && (
          <label>Target{" "}
            <select value={target.name} onChange={(event) => (shown.value = event.currentTarget.value)}>
              {score.targets.map((t) => <option key={t.name}>{t.name}</option>)}
            </select>
          </label>
        )}
        <button type="button" aria-pressed={open} disabled={allowances !== null} onClick={() => (all.value = !all.value)}>Components too</button>
        {!allowances && score.verdict.checks.length > 0 && (
          <button type="button" disabled={!current.value || runs.value.some(unfinished)} onClick={() => start(SLACK, "/v1/reports", { parts: ["score"] })}>How far may each be loosened?</button>
        )}
        {seeking && <span class="note" role="status">{`being computed: ${percent(seeking.fraction, 0)} `}<progress aria-label={SLACK} max={1} value={seeking.fraction} /></span>}
      </p>
      {allowances && <p class="note">{slackWords(allowances, target.name, score)}</p>}
      <div class="scroll" tabIndex={0} role="region" aria-label="Table of the budget">
        <table class={allowances ? "slack" : ""}>
          <caption><Term word="budget">Budget</Term>: <Term word="share">shares</Term> of variance{`${score.targets.length > columns.length ? `, the ${columns.length} of ${score.targets.length} targets with the largest P95` : ""}`}</caption>
          <thead>
            <tr>
              <th><Term word="contributor">Contributor</Term></th><th class="number"><Term word="half-width">Half-width</Term></th>
              {allowances && <th class="number">Slack</th>}
              <th>{`Waterfall, ${target.name}`}</th><th class="number"><Term word="P95">P95</Term> without, mm</th><th class="number">P95 per unit of half-width</th>
              {columns.map((t) => <th class="number" key={t.name}>{t.name}</th>)}
            </tr>
          </thead>
          <tbody>
            {rows.flatMap(({ whole, parts }) => {
              const begin = reached;
              reached += target.contributors[whole].variance_share;
              const shownParts = open ? parts : [];
              return [whole, ...shownParts].map((k) => {
                const c = target.contributors[k];
                return (
                  <tr key={c.name + c.component} class={k === whole ? "" : "below"}>
                    <th>{k === whole ? c.label || c.name : c.component}</th>
                    <td class="number">{c.half_width === null ? "" : `${brief(c.half_width)} ${unit(c.unit)}`}</td>
                    {allowances && <td class="number">{slackOf(allowances.find((a) => a.target === target.name && a.contributor === c.name && a.component === c.component))}</td>}
                    <td>
                      {k === whole && (
                        <svg class="waterfall" viewBox="0 0 100 10" preserveAspectRatio="none" aria-hidden="true">
                          <rect x={100 * begin} y="1" width={Math.max(0.4, 100 * c.variance_share)} height="8" />
                        </svg>
                      )}
                    </td>
                    <td class="number">{mm(c.p95_without_mm)}</td>
                    <td class="number">{c.dp95_per_unit === null ? "" : `${brief(c.dp95_per_unit)} mm/${unit(c.unit)}`}</td>
                    {columns.map((t) => <td class="number share" key={t.name}><Share value={t.contributors[k]?.variance_share ?? 0} before={before.value?.shares[shareKey(t.name, c.name, c.component)]} /></td>)}
                  </tr>
                );
              });
            })}
          </tbody>
        </table>
      </div>
    </div>
  );
}

const unit = (name: string) => name.replace("deg", "°");

function Share({ value, before: was }: { value: number; before?: number }) {
  const by = was === undefined ? 0 : 100 * (value - was);
  return (
    <>
      <svg class="bar" viewBox="0 0 100 10" preserveAspectRatio="none" aria-hidden="true"><rect y="1" width={100 * Math.min(1, value)} height="8" /></svg>
      {percent(value)}
      {Math.abs(by) >= 0.05 && <span class={by < 0 ? "delta less" : "delta more"}>{` ${changed(by, 1)}`}</span>}
    </>
  );
}
