// Renders the formulas that pymdownx.arithmatex marks, with KaTeX 0.19.1 (docs/katex, from npm), without network access.
for (const element of document.querySelectorAll(".arithmatex")) {
  const latex = element.textContent.trim().slice(2, -2);
  katex.render(latex, element, { displayMode: element.tagName === "DIV", throwOnError: false });
}
