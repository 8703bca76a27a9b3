// Small helpers of the page.

export const $ = id => document.getElementById(id);

export function element(tag, attributes = {}, ...content) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (typeof value === "boolean") made.toggleAttribute(name, value);
    else if (value !== null && value !== undefined) made.setAttribute(name, value);
  }
  made.append(...content.filter(part => part !== null && part !== undefined));
  return made;
}

export function fill(parent, ...content) {
  parent.replaceChildren(...content.filter(part => part !== null && part !== undefined));
}

// Show why something could not be done, where everybody sees it; nothing takes it away again.
export function problem(error) {
  $("problem").textContent = error ? error.message ?? String(error) : "";
  $("problem").hidden = !error;
}

// A function that does something and shows why it could not be done.
export function guarded(work) {
  return async (...given) => {
    try {
      problem(null);
      return await work(...given);
    } catch (error) {
      problem(error);
      return undefined;
    }
  };
}

export function duration(seconds) {
  if (seconds < 1) return "under 1 s";
  if (seconds < 90) return `${Math.round(seconds)} s`;
  if (seconds < 5400) return `${Math.round(seconds / 60)} min`;
  return `${(seconds / 3600).toFixed(1)} h`;
}

export function size(bytes) {
  if (bytes < 1e5) return `${(bytes / 1e3).toFixed(1)} kB`;
  if (bytes < 1e9) return `${(bytes / 1e6).toFixed(1)} MB`;
  return `${(bytes / 1e9).toFixed(2)} GB`;
}

// A figure with as many digits as its standard deviation gives: two of that.
export function figure(value, sigma, unit) {
  if (value === null) return "not known";
  if (sigma === null || sigma === undefined) return `${value.toFixed(unit === "m" ? 3 : 2)} ${unit}`;
  const digits = Math.min(Math.max(1 - Math.floor(Math.log10(Math.max(sigma, 1e-9))), 0), 4);
  return `${value.toFixed(digits)} ± ${sigma.toFixed(digits)} ${unit}`;
}

export const plural = (count, what) => `${count} ${what}${count === 1 ? "" : "s"}`;
