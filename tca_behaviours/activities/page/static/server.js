// The way to the server: news of the application, and commands for it.

const KEY = "key"; // of the address that the command printed: without it a page only looks

// Out of the address, which may be sent to others.
function takeKey() {
  const address = new URL(location.href), given = address.searchParams.get(KEY);
  if (given === null) return;
  sessionStorage.setItem(KEY, given);
  address.searchParams.delete(KEY);
  history.replaceState(null, "", address);
}

takeKey();

export const maySteer = () => sessionStorage.getItem(KEY) !== null;

// Calls `take` with the parts that have changed, for ever, and `lose` with a text when the server is gone.
export async function follow(take, lose) {
  for (let serial = 0; ;) {
    try {
      const answer = await fetch(`api/news?since=${serial}`), news = await answer.json();
      if (news.serial < serial) location.reload(); // another server, with another key
      serial = news.serial;
      take(news.parts);
    } catch (error) {
      lose(`the server of this page does not answer (${error.message})`);
      await new Promise((done) => setTimeout(done, 1000));
      serial = 0;
    }
  }
}

// What became of a command: { text, isBad }.
export async function send(message, data = null) {
  try {
    const answer = await fetch("api/send", {
      method: "POST", body: JSON.stringify({ message, data }), headers: { "X-TCA-Key": sessionStorage.getItem(KEY) ?? "" },
    });
    if (answer.status === 403) sessionStorage.removeItem(KEY);
    const { said, error } = answer.status === 404 ? { error: "this page may only look" } : await answer.json();
    return { text: said ?? error, isBad: said === undefined };
  } catch (error) {
    return { text: `the server of this page does not answer (${error.message})`, isBad: true };
  }
}
