// What a review says about a bead or a line of the budget, where that stands: pressed, it is shown among the comments.

import { signal } from "@preact/signals";
import { comments, type Json } from "../state";

export const shownComment = signal<number | null>(null); // the one that is to be seen, by its place

/** What is not settled of what is said about a bead, or a line. */
export const saidOf = (bead?: string, contributor?: string, component?: string): { k: number; text: string }[] =>
  comments.value.flatMap((each: Json, k) => (!each?.resolved && each?.bead === bead && each?.contributor === contributor && each?.component === component ? [{ k, text: String(each.text ?? "") }] : []));

export function Pin({ bead, contributor, component }: { bead?: string; contributor?: string; component?: string }) {
  const said = saidOf(bead, contributor, component), words = said.map(({ text }) => text).join("\n");
  return said.length ? <button type="button" class="pin" title={words} aria-label={`${said.length === 1 ? "A comment" : `${said.length} comments`}: ${words}`} onClick={(event) => { event.stopPropagation(); shownComment.value = said[0].k; }}>{said.length}</button> : null;
}
