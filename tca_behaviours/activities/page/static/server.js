// The connection to the server: changes of the application, and commands for it.

const KEY = "key"; // a parameter of the address that the command printed; without it the page is read-only

// Store the key, and remove it from the address, which the user may send to others.
function storeKey() {
  const address = new URL(location.href), given = address.searchParams.get(KEY);
  if (given === null) return;
  sessionStorage.setItem(KEY, given);
  address.searchParams.delete(KEY);
  history.replaceState(null, "", address);
}

storeKey();

export const hasKey = () => sessionStorage.getItem(KEY) !== null;

// Calls `update` with the changed parts, for ever, and `lose` with a text when the server does not answer.
export async function follow(update, lose) {
  for (let serial = 0; ;) {
    try {
      const answer = await fetch(`api/news?since=${serial}`), news = await answer.json();
      if (news.serial < serial) location.reload(); // another server, with another key
      serial = news.serial;
      update(news.parts);
    } catch (error) {
      lose(`the server of this page does not answer (${error.message})`);
      await new Promise((done) => setTimeout(done, 1000));
      serial = 0;
    }
  }
}

// Send a command. Returns its outcome: { text, isBad }.
export async function send(message, data = null) {
  try {
    const answer = await fetch("api/send", {
      method: "POST", body: JSON.stringify({ message, data }), headers: { "X-TCA-Key": sessionStorage.getItem(KEY) ?? "" },
    });
    if (answer.status === 403) sessionStorage.removeItem(KEY);
    const { said, error } = answer.status === 404 ? { error: "this page is read-only" } : await answer.json();
    return { text: said ?? error, isBad: said === undefined };
  } catch (error) {
    return { text: `the server of this page does not answer (${error.message})`, isBad: true };
  }
}
