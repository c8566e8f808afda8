// What the theme leaves out for keyboards and screen readers: tables that scroll can be reached, toolbars have names.
"use strict";

function nameParts() {
  document.querySelectorAll(".md-code__nav:not([aria-label])").forEach((tools) => {
    nameParts.codes = (nameParts.codes || 0) + 1;
    tools.setAttribute("aria-label", "tools of code block " + nameParts.codes);
  });
  document.querySelectorAll(".md-search:not([aria-label])").forEach((search) => search.setAttribute("aria-label", "search"));
  document.querySelectorAll(".md-typeset__scrollwrap:not([tabindex])").forEach((table) => {
    nameParts.tables = (nameParts.tables || 0) + 1;
    table.tabIndex = 0;
    table.setAttribute("role", "region");
    table.setAttribute("aria-label", "table " + nameParts.tables);
  });
}

/** Formulas that are wider than the screen scroll, by keyboard too. */
function reachFormulas() {
  document.querySelectorAll(".formula").forEach((formula) => {
    if (formula.scrollWidth > formula.clientWidth + 1 && formula.clientWidth) formula.tabIndex = 0;
    else formula.removeAttribute("tabindex");
  });
}

window.addEventListener("load", reachFormulas);
window.addEventListener("resize", reachFormulas);
new MutationObserver(nameParts).observe(document.documentElement, { childList: true, subtree: true });
nameParts();
