/**
 * Preloads the modules of the view that the address names, and the picture of its scene, since every round trip counts on a slow line.
 * A classic script in the head, so that these load together with the page's own modules.
 */

(() => {
  const REST_AFTER_MS = 3000;

  /**
   * By view, and for uploads: URLs of modules that the page does not load itself. Filled in by the service.
   * @type {Record<string, string[]>}
   */
  const modules = JSON.parse(document.getElementById("view-modules")?.textContent || "{}");
  /** @type {Set<string>} */
  const asked = new Set();

  /** View names by address, from the table in ../views/showing.js. @type {Record<string, string>} */
  const views = JSON.parse(document.getElementById("view-addresses")?.textContent || "{}");

  /** @param {string} hash @returns {string | null} the address of the view in the table; null: there is nothing here */
  function viewAt(hash) {
    const [path = ""] = hash.replace(/^#/, "").split("?", 1);
    const [section = "", id] = path.split("/").filter(Boolean);
    for (const address of id ? [`${section}/ID`, section] : [section]) if (Object.hasOwn(views, address)) return address;
    return null;
  }

  /**
   * @param {string} href
   * @param {"auto" | "low"} fetchPriority
   * @returns {Promise<unknown>} settles when it is loaded or has failed
   */
  function ask(href, fetchPriority) {
    asked.add(href);
    const link = Object.assign(document.createElement("link"), { rel: "modulepreload", href, fetchPriority });
    const over = new Promise((done) => (link.onload = link.onerror = done));
    document.head.append(link);
    return over;
  }

  /** @param {string | null} address @param {"auto" | "low"} [priority] */
  function fetchView(address, priority = "auto") {
    const view = address === null ? undefined : views[address];
    const hrefs = (view && modules[view]) || [];
    return Promise.all(hrefs.filter((href) => !asked.has(href)).map((href) => ask(href, priority)));
  }

  /** Preloads modules one after another, to leave bandwidth for other requests. @param {string[]} hrefs */
  async function fetchSlowly(hrefs) {
    for (const href of hrefs) if (!asked.has(href)) await ask(href, "low");
  }

  /** Loads the picture with which the page of a scene begins (outline in ../views/scene.js). @param {string} id of the scene */
  async function fetchPicture(id) {
    const answer = await fetch(`api/scenes/${id}`);
    const { poster, thumbnail } = answer.ok ? await answer.json() : {};
    const url = poster ?? (thumbnail && `api/scenes/${id}/thumbnail.png`);
    if (url) new Image().src = url.replace(/^\//, "");
  }

  fetchView(viewAt(location.hash));
  const [, scene] = location.hash.match(/^#\/scenes\/([0-9a-f]+)$/) ?? [];
  if (scene) fetchPicture(scene).catch(() => {}); // the page itself reports why the scene is not here
  // A link under the pointer or with focus is likely to be followed.
  for (const hint of ["pointerover", "focusin"])
    addEventListener(hint, ({ target }) => {
      const link = target instanceof Element ? target.closest("a") : null;
      if (link?.getAttribute("href")?.startsWith("#/")) fetchView(viewAt(link.hash));
    }, { passive: true });

  Object.assign(window, {
    rayfarmViews: {
      viewAt,
      /** Called once the first view is shown. Returns whether the view of scenes is loaded too, since the user does not save data. */
      async viewShown() {
        await fetchSlowly(modules.uploads ?? []); // so that a dropped file is handled without delay
        if (/** @type {any} */ (navigator).connection?.saveData === true) return false;
        await fetchView("scenes/ID", "low");
        setTimeout(() => void fetchSlowly(Object.values(modules).flat()), REST_AFTER_MS);
        return true;
      },
    },
  });
})();
