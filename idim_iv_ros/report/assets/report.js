// Inflates plotly, draws the figures in the present colour scheme, sorts tables.
'use strict';

const config = {displayModeBar: false, responsive: true};
const root = document.documentElement;
const figures = new Map();  // place → drawing as it was written

const inflate = async packed => {
  const bytes = Uint8Array.from(atob(packed), letter => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'));
  return new Response(stream).text();
};

// {"levels": 16-bit integers in base64, "low", "step"} → numbers; 65535 is a break.
const unpacked = ({levels, low, step}) => {
  const bytes = Uint8Array.from(atob(levels), letter => letter.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  return Float64Array.from({length: bytes.length / 2}, (_, k) => {
    const level = view.getUint16(2 * k, true);
    return level === 65535 ? NaN : low + step * level;
  });
};

// What all figures look like, also where they say nothing of it.
const font = {family: "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif", size: 12};
const axis = {
  title: {standoff: 6, font: {size: 12}}, automargin: true, gridcolor: 'var(--grid)', zeroline: false,
  linecolor: 'var(--grey)', showline: true, ticks: 'outside', ticklen: 4, tickcolor: 'var(--grey)',
  tickfont: {size: 11}, exponentformat: 'power',
};
const style = {
  font: {...font, color: 'var(--ink)'}, paper_bgcolor: 'var(--page)', plot_bgcolor: 'var(--page)',
  margin: {l: 58, r: 12, t: 8, b: 40}, showlegend: false, hoverlabel: {font}, hovermode: 'closest',
  dragmode: 'zoom', xaxis: axis, yaxis: axis,
};

// "var(--blue)" → its value now; {"same": k} → the abscissa of trace k.
const resolved = ({data, layout}) => {
  const values = getComputedStyle(root);
  const drawing = {data, layout: {template: {layout: style}, ...layout}};
  const text = JSON.stringify(drawing, (key, value) => {
    const name = typeof value === 'string' && /^var\((--[a-z-]+)\)$/.exec(value);
    return name ? values.getPropertyValue(name[1]).trim() : value;
  });
  const copy = JSON.parse(text);
  for (const trace of copy.data) {
    for (const letter of ['x', 'y']) {
      const values = trace[letter];
      if (values && values.levels !== undefined) trace[letter] = unpacked(values);
      else if (values && values.same !== undefined) trace[letter] = copy.data[values.same].x;
    }
  }
  return copy;
};

const draw = place => {
  const drawing = resolved(figures.get(place));
  // On paper there is no time to follow a width that changes.
  if (root.classList.contains('print')) drawing.layout.width = place.clientWidth;
  return Plotly.react(place, drawing.data, drawing.layout, config);
};
const redraw = () => figures.forEach((_, place) => { if (place.data) draw(place); });

const drawAll = () => {
  for (const script of document.querySelectorAll('script[data-figure]')) {
    const place = document.getElementById(script.dataset.figure);
    figures.set(place, JSON.parse(script.textContent));
    // What is folded has no width yet.
    const fold = place.closest('details:not([open])');
    if (fold) fold.addEventListener('toggle', () => draw(place), {once: true});
    else draw(place);
  }
};

// A narrow screen shows the first joints.
if (innerWidth < 560) {
  document.querySelectorAll('details.wide-open').forEach(fold => { fold.open = false; });
}

const missing = words => {
  for (const place of document.querySelectorAll('.figure')) {
    place.textContent = `This figure cannot be drawn: ${words}`;
    place.style.height = 'auto';
  }
};

const start = async () => {
  if (typeof DecompressionStream === 'undefined') {
    missing('the browser is older than 2023.');
    return;
  }
  const library = document.createElement('script');
  library.textContent = await inflate(document.getElementById('plotly').textContent);
  document.head.append(library);
  drawAll();
};
start().catch(error => missing(error.message));

matchMedia('(prefers-color-scheme: dark)').addEventListener('change', redraw);
// A link to what is folded opens it.
const reveal = () => {
  const place = location.hash && document.getElementById(location.hash.slice(1));
  const fold = place && place.closest('details');
  if (fold) { fold.open = true; place.scrollIntoView(); }
};
addEventListener('hashchange', reveal);
reveal();

// Paper is white, and narrower than a screen.
const printing = on => () => {
  root.classList.toggle('print', on);
  if (on) document.querySelectorAll('details.fold').forEach(fold => { fold.open = true; });
  redraw();
};
addEventListener('beforeprint', printing(true));
addEventListener('afterprint', printing(false));

for (const table of document.querySelectorAll('table.sortable')) {
  table.querySelectorAll('th[data-column]').forEach(head => {
    head.querySelector('button').addEventListener('click', () => {
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
