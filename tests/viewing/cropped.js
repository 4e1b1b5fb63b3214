// Boxes whose content is wider than they are: it would have to be scrolled sideways, or is cut.
() => [...document.querySelectorAll("main, section, .scroll, table, td, figure, dl, ul, ol, p, .legend, .bar, .chips")]
  .filter((e) => e.getClientRects().length && e.scrollWidth > e.clientWidth + 1)
  .map((e) => `${e.tagName} ${e.className} ${e.id}: ${e.scrollWidth} > ${e.clientWidth}`)
