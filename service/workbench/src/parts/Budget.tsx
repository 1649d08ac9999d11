// Which contributor is to blame: a matrix of contributors and targets, and a waterfall of one target's variance.

import { signal } from "@preact/signals";
import { answer, current, type TargetScore } from "../api";
import { brief, mm, percent } from "../words";

const shown = signal<string | null>(null); // target of the waterfall
const all = signal(false);

/** Contributors of a target, each with its components: the lines of "all" add up, their components are below them. */
function families(target: TargetScore): { whole: number; parts: number[] }[] {
  const found = new Map<string, { whole: number; parts: number[] }>();
  target.contributors.forEach((c, k) => {
    const family = found.get(c.name) ?? { whole: -1, parts: [] };
    if (c.component === "all") family.whole = k;
    else family.parts.push(k);
    found.set(c.name, family);
  });
  const share = (k: number) => target.contributors[k].variance_share;
  const all = [...found.values()].flatMap((f) => (f.whole >= 0 ? [f] : f.parts.map((k) => ({ whole: k, parts: [] }))));
  for (const family of all) family.parts.sort((a, b) => share(b) - share(a));
  return all.sort((a, b) => share(b.whole) - share(a.whole));
}

export function Budget() {
  const score = answer.value?.score;
  if (!score) return null;
  const target = score.targets.find((t) => t.name === shown.value) ?? score.targets[0];
  const rows = families(target), columns = score.targets.slice(0, 8), first = rows[0] && target.contributors[rows[0].whole];
  let start = 0;
  return (
    <div class={current.value ? "budget" : "budget old"}>
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
        <button type="button" aria-pressed={all.value} onClick={() => (all.value = !all.value)}>Components too</button>
      </p>
      <div class="scroll" tabIndex={0} role="region" aria-label="Budget">
        <table>
          <caption>{`Budget: shares of variance${score.targets.length > columns.length ? `, first ${columns.length} of ${score.targets.length} targets` : ""}`}</caption>
          <thead>
            <tr>
              <th>Contributor</th><th class="number">Half-width</th>
              {columns.map((t) => <th class="number" key={t.name}>{t.name}</th>)}
              <th>{`Waterfall, ${target.name}`}</th><th class="number">P95 without, mm</th><th class="number">P95 per unit of half-width</th>
            </tr>
          </thead>
          <tbody>
            {rows.flatMap(({ whole, parts }) => {
              const begin = start;
              start += target.contributors[whole].variance_share;
              const shownParts = all.value ? parts : [];
              return [whole, ...shownParts].map((k) => {
                const c = target.contributors[k];
                return (
                  <tr key={c.name + c.component} class={k === whole ? "" : "below"}>
                    <th>{k === whole ? c.label || c.name : c.component}</th>
                    <td class="number">{c.half_width === null ? "" : `${brief(c.half_width)} ${unit(c.unit)}`}</td>
                    {columns.map((t) => <td class="number share" key={t.name}><Share value={t.contributors[k]?.variance_share ?? 0} /></td>)}
                    <td>
                      {k === whole && (
                        <svg class="waterfall" viewBox="0 0 100 10" preserveAspectRatio="none" aria-hidden="true">
                          <rect x={100 * begin} y="1" width={Math.max(0.4, 100 * c.variance_share)} height="8" />
                        </svg>
                      )}
                    </td>
                    <td class="number">{mm(c.p95_without_mm)}</td>
                    <td class="number">{c.dp95_per_unit === null ? "" : `${brief(c.dp95_per_unit)} mm/${unit(c.unit)}`}</td>
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

function Share({ value }: { value: number }) {
  return (
    <>
      <svg class="bar" viewBox="0 0 100 10" preserveAspectRatio="none" aria-hidden="true"><rect y="1" width={100 * Math.min(1, value)} height="8" /></svg>
      {percent(value)}
    </>
  );
}
