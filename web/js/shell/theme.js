/**
 * Dark or light theme: the system's, unless the user chose one. A classic script in the head, because a module would run after
 * the first paint and briefly show the wrong theme.
 */

/** @typedef {"system" | "light" | "dark"} Theme */

(() => {
  const KEY = "rayfarm.theme";

  /** @returns {Theme} */
  function stored() {
    try {
      const value = localStorage.getItem(KEY);
      return value === "light" || value === "dark" ? value : "system";
    } catch {
      return "system"; // storage is blocked: the choice lasts until the page is closed
    }
  }

  /** @param {Theme} theme */
  function apply(theme) {
    if (theme === "system") delete document.documentElement.dataset.theme;
    else document.documentElement.dataset.theme = theme;
  }

  let theme = stored();
  apply(theme);

  Object.assign(window, {
    rayfarmTheme: {
      get: () => theme,
      /** @param {Theme} next */
      set(next) {
        theme = next;
        apply(next);
        try {
          if (next === "system") localStorage.removeItem(KEY);
          else localStorage.setItem(KEY, next);
        } catch {
          // As above.
        }
      },
    },
  });
})();
