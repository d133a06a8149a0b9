// What checkers that nobody here wrote say of pages of tvsgs: report.html, view.html, any other.
//
//     node scripts/page_judges.mjs FOLDER PAGE.html... [--pictures DIR]
//
// FOLDER: where `npm install axe-core puppeteer-core vnu-jar` has been run; vnu wants Java, puppeteer-core Chromium. Each
// page is validated as HTML; then, light and dark, 1280 and 390 pixels wide: axe's rules for WCAG 2.2 AA, nothing is asked
// for elsewhere, nothing is wider than the window, and Tab reaches all that can be used, with a focus that shows.
// Exits with 1 where one disagrees. Never needed to build or test.
import {spawnSync} from 'node:child_process';
import fs from 'node:fs';
import {createRequire} from 'node:module';
import path from 'node:path';
import {pathToFileURL} from 'node:url';

const words = process.argv.slice(2), at = words.indexOf('--pictures');
const pictures = at < 0 ? null : words.splice(at, 2)[1];
const [folder, ...pages] = words;
if (!folder || pages.length == 0) {
  console.error('usage: node scripts/page_judges.mjs FOLDER PAGE.html... [--pictures DIR]');
  process.exit(2);
}
const require = createRequire(path.join(path.resolve(folder), 'x.js'));
let wrong = 0;
function complain(text) {
  ++wrong;
  console.log(`FAIL ${text}`);
}

function validate(page) {
  const result = spawnSync('java', ['-Xss4m', '-jar', require('vnu-jar'), '--format', 'json', '--stdout', page],
                           {encoding: 'utf8', maxBuffer: 1 << 28});
  if (result.error) throw result.error;
  for (const m of JSON.parse(result.stdout).messages)
    if (m.type == 'error') complain(`vnu, line ${m.lastLine}: ${m.message} ${(m.extract || '').slice(0, 160)}`);
    else console.log(`     vnu, line ${m.lastLine}: ${m.message}`);
}

/// All that can be used, and where Tab leads.
async function walk(page) {
  const all = await page.evaluate(() => {
    const shown = e => e.checkVisibility({visibilityProperty: true}) && !e.disabled && !e.closest('details:not([open]) > :not(summary)');
    const found = [...document.querySelectorAll('a[href], button, input, summary, iframe, [tabindex="0"]')].filter(shown);
    found.forEach((e, i) => e.dataset.judged = i);
    document.activeElement.blur();
    window.scrollTo(0, 0);
    return found.map(e => e.outerHTML.slice(0, 90));
  });
  const reached = new Set(), dim = new Set();
  for (let step = 0; step < all.length + 60 && reached.size < all.length; ++step) {
    await page.keyboard.press('Tab');
    const here = await page.evaluate(() => {
      const e = document.activeElement, s = getComputedStyle(e.id == 'canvas' ? e.parentElement : e);  // the view's stage shows it
      return {i: e.dataset.judged, shows: s.outlineStyle != 'none' && parseFloat(s.outlineWidth) >= 2, what: e.outerHTML.slice(0, 90)};
    });
    if (here.i === undefined) continue;
    reached.add(Number(here.i));
    if (!here.shows) dim.add(here.what);
  }
  all.forEach((what, i) => reached.has(i) || complain(`Tab does not reach ${what}`));
  for (const what of dim) complain(`focus does not show: ${what}`);
  return all.length;
}

async function judge(browser, file) {
  for (const scheme of ['light', 'dark'])
    for (const width of [1280, 390]) {
      const page = await browser.newPage(), name = `${path.basename(file)}, ${scheme}, ${width} px`;
      await page.setViewport({width, height: width > 600 ? 900 : 780});
      await page.emulateMediaFeatures([{name: 'prefers-color-scheme', value: scheme}]);
      page.on('request', r => /^(data|blob|about):/.test(r.url()) || r.url().startsWith('file://') && r.isNavigationRequest() ||
                              complain(`${name}: asks for ${r.url()}`));
      page.on('console', m => m.type() == 'error' && complain(`${name}: console: ${m.text()}`));
      page.on('pageerror', e => complain(`${name}: ${e.message}`));
      await page.goto(pathToFileURL(path.resolve(file)).href);
      const canvas = await page.$('#canvas');
      if (canvas) {
        await page.waitForFunction(() => /^Ready/.test(document.getElementById('status').textContent), {timeout: 120000});
        await canvas.focus();
        for (const key of [']', 'e']) await page.keyboard.press(key);  // shows the photograph's slider and the scale of errors
        await new Promise(r => setTimeout(r, 3000));
      }
      await page.evaluate(fs.readFileSync(require.resolve('axe-core/axe.min.js'), 'utf8'));
      const found = await page.evaluate(
          () => axe.run(document, {runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa', 'best-practice'], resultTypes: ['violations']}));
      for (const v of found.violations)
        complain(`${name}: axe, ${v.id}, ${v.impact}: ${v.help}: ` + v.nodes.slice(0, 3).map(n => n.html.slice(0, 120) + ' ' +
                 (n.any[0]?.message ?? '')).join(' | ') + (v.nodes.length > 3 ? ` and ${v.nodes.length - 3} more` : ''));
      const over = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
      if (over > 0) complain(`${name}: ${over} px wider than the window`);
      if (pictures) await page.screenshot({path: path.join(pictures, `${path.basename(file, '.html')}_${scheme}_${width}.png`), fullPage: true});
      const count = await walk(page);
      console.log(`     ${name}: ${found.violations.length} violations; ${count} places for Tab`);
      await page.close();
    }
}

if (pictures) fs.mkdirSync(pictures, {recursive: true});
const chromium = ['chromium', 'chromium-browser', 'google-chrome'].map(n => spawnSync('sh', ['-c', `command -v ${n}`], {encoding: 'utf8'}).stdout.trim()).find(p => p);
const {default: puppeteer} = await import(pathToFileURL(require.resolve('puppeteer-core')).href);
const browser = await puppeteer.launch({
  executablePath: chromium,
  args: ['--use-angle=swiftshader', '--enable-unsafe-swiftshader', ...(process.getuid() == 0 ? ['--no-sandbox'] : [])]
});
for (const page of pages) {
  console.log(`     ${page}: vnu ${require('vnu-jar/package.json').version}, axe ${require('axe-core').version}`);
  validate(page);
  await judge(browser, page);
}
await browser.close();
process.exit(wrong ? 1 : 0);
