"""The few lines of JavaScript of the report: draw figures, refit them for print, sort tables."""

SCRIPT = """
const config = {displayModeBar: false, responsive: true};
const figures = [];
const draw = (script, place) => {
  const drawing = JSON.parse(script.textContent);
  Plotly.newPlot(place, drawing.data, drawing.layout, config);
  figures.push(place);
};
for (const script of document.querySelectorAll('script[data-figure]')) {
  const place = document.getElementById(script.dataset.figure);
  // What is folded has no width yet.
  const fold = place.closest('details:not([open])');
  if (fold) fold.addEventListener('toggle', () => draw(script, place), {once: true});
  else draw(script, place);
}
const refit = () => figures.forEach(place => Plotly.Plots.resize(place));
window.addEventListener('beforeprint', refit);
window.addEventListener('afterprint', refit);
for (const table of document.querySelectorAll('table.sortable')) {
  table.querySelectorAll('th[data-column]').forEach(head => {
    const button = head.querySelector('button');
    button.addEventListener('click', () => {
      const up = head.getAttribute('aria-sort') !== 'ascending';
      table.querySelectorAll('th').forEach(other => other.removeAttribute('aria-sort'));
      head.setAttribute('aria-sort', up ? 'ascending' : 'descending');
      const column = Number(head.dataset.column), body = table.tBodies[0];
      const key = row => {
        const cell = row.cells[column];
        return cell.dataset.key === undefined ? -Infinity : Number(cell.dataset.key);
      };
      [...body.rows]
        .sort((a, b) => (up ? 1 : -1) * (key(a) - key(b)))
        .forEach(row => body.append(row));
    });
  });
}
"""
