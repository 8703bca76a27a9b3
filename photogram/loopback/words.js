// What a page says, in the language of whoever looks at it. A message stands in English where it is said, a whole
// sentence or phrase with named placeholders, and is looked up by that text; what the catalog lacks is said in English.

const ATTRIBUTES = ["aria-label", "title", "placeholder", "alt"];
const WORD = /\p{L}{2,}/u;
const COOKIE = "photogram_language"; // kept for this machine, whatever the port
const YEAR_S = 31536000;

let words = { code: "en", tag: "en-GB", languages: [], messages: {} };
let plurals = new Intl.PluralRules("en-GB");

// The code of the language, and all that can be chosen: { code, name }.
export const code = () => words.code;
export const languages = () => words.languages;

const filled = (form, values) => form.replace(/\{(\w+)\}/g, (_, name) => values[name]);

export const t = (english, values = {}) => filled(words.messages[english] ?? english, values);

// A message in the form that goes with a count, which is its placeholder n.
export function nt(one, several, count, values = {}) {
  const forms = words.messages[one] ?? [one, several];
  return filled(forms[plurals.select(count) === "one" ? 0 : 1], { n: count, ...values });
}

// A number with so many decimals, and one with as many as it has, at most six.
export function fixed(value, digits) {
  return value.toLocaleString(words.tag, { minimumFractionDigits: digits, maximumFractionDigits: digits, useGrouping: false });
}

export const number = value => value.toLocaleString(words.tag, { maximumFractionDigits: 6, useGrouping: false });

// The number that somebody has typed, with a point or a comma; NaN where it is none.
export const typed = text => (text.trim() ? Number(text.trim().replace(",", ".")) : NaN);

// Names in a row: a, b and c.
export const listed = names => new Intl.ListFormat(words.tag).format(names);

// The texts of the page itself, as they stand in its HTML.
const own = [];
const isLeft = element => element.closest("[translate=no], script, style, title") !== null;

function collect() {
  const texts = document.createTreeWalker(document.documentElement, NodeFilter.SHOW_TEXT);
  for (let node = texts.nextNode(); node; node = texts.nextNode()) {
    const english = node.data.trim().replace(/\s+/g, " ");
    if (!WORD.test(english) || isLeft(node.parentElement)) continue;
    const [before] = node.data.match(/^\s*/), [after] = node.data.match(/\s*$/);
    own.push({ english, say: text => { node.data = before + text + after; } });
  }
  for (const name of ATTRIBUTES) {
    for (const element of document.querySelectorAll(`[${name}]`)) {
      const english = element.getAttribute(name);
      if (WORD.test(english) && !isLeft(element)) own.push({ english, say: text => element.setAttribute(name, text) });
    }
  }
}

async function load() {
  const response = await fetch("words.json");
  if (!response.ok) return;
  words = await response.json();
  plurals = new Intl.PluralRules(words.tag);
  document.documentElement.lang = words.tag;
  for (const { english, say } of own) say(words.messages[english] ?? english);
}

// Choose a language, for this page and for those that are opened later.
export async function speak(language) {
  document.cookie = `${COOKIE}=${language}; path=/; max-age=${YEAR_S}; SameSite=Strict`;
  await load();
}

collect();
await load().catch(() => null); // what asks next says that nobody answers
